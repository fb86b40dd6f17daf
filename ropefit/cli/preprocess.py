"""`ropefit preprocess`: a recording becomes observations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ropefit.cli.options import (
    OF_EXPERTS,
    DebugImages,
    ForceOther,
    Mask,
    Nodes,
    Project,
    ProjectChoice,
    RecordingPath,
    Roi,
    RopeColor,
    Run,
    command,
)

if TYPE_CHECKING:
    from ropefit.artifacts import DroppedFrame
    from ropefit.cli.console import Session

TOLD = 3  # dropped frames; the report tells all


@command
def preprocess(
    session: Session,
    recording: RecordingPath = None,
    run: Run = Path("run"),
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    most_points: Annotated[
        int,
        typer.Option(help="The most points that are kept of a frame.", rich_help_panel=OF_EXPERTS),
    ] = 400,
    color: RopeColor = None,
    roi: Roi = None,
    mask: Mask = None,
    debug_images: DebugImages = None,
    force: ForceOther = False,
) -> None:
    """Order and segment the recorded points; measure their noise."""
    from ropefit.cli.parsing import picture_settings

    settings = {"nodes": nodes, "project": project.value, "most_points": most_points}
    settings |= picture_settings(color, roi, mask)
    session.result(show_observations(session, recording, run, settings, force, debug_images))


def show_observations(
    session: Session,
    recording: Path | None,
    run: Path,
    settings: dict[str, Any],
    force: bool,
    debug_images: Path | None,
) -> dict[str, Any]:
    """Preprocess, print what came out, and return its summary."""
    from ropefit.api import runs
    from ropefit.api.summaries import preprocessed
    from ropefit.recordings import sample_path

    if recording is None:
        recording = sample_path()
        session.say(f"no RECORDING given: using the packaged sample {recording}")
    outcome = runs.preprocess(
        recording, run, settings, session.context("preprocess"), force, debug_images
    )
    session.finished("preprocess", outcome)
    o, data = outcome.artifact, preprocessed(outcome)
    session.table(
        f"{o.recording}: observations",
        ["", ""],
        [
            ["frames", f"{len(o.frames)} used, {len(o.dropped)} dropped"],
            *_dropped(o.dropped),
            [
                "rope",
                f"{o.length:.4g} m ({o.length_source}); {_held(o.end_kind)}",
            ],
            ["noise", f"{data['noise_m'] * 1e3:.2g} mm per coordinate ({o.noise_source})"],
            ["seen", f"{o.visibility.mean():.0%} of the rope"],
            ["plane", o.projection_reason],
        ],
    )
    if o.ends_assumed:
        session.say("no [ends] in the recording: the ends visible in the data are taken as pinned")
    if not o.depth_measured:
        session.say(
            "no depth in the recording: points lie on an assumed plane. OBJ2, OBJ5 and OBJ8 "
            "compare pictures; --solver equilibrium compares the rope across in the picture, if "
            "[rope] length and [ends] are given"
        )
    return data


def _dropped(dropped: list[DroppedFrame]) -> list[list[str]]:
    """Return rows on the first dropped frames, each with the reason."""
    rows = [["dropped", f"frame {drop.frame}: {drop.reason}"] for drop in dropped[:TOLD]]
    more = len(dropped) - TOLD
    return rows if more <= 0 else [*rows, ["", f"and {more} more, see the report"]]


def _held(kinds: tuple[str, str]) -> str:
    """Return how both ends are held, in words."""
    first, second = kinds
    return f"both ends {first}" if first == second else f"end 0 {first}, end 1 {second}"
