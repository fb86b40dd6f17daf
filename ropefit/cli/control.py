"""`ropefit control`: where the control point was, or where it must go."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from ropefit.cli.options import OF_EXPERTS, Force, LossOption, Run, Target, command

if TYPE_CHECKING:
    import numpy as np

    from ropefit.artifacts import Control
    from ropefit.cli.console import Session
    from ropefit.runs.protocol import Outcome


@command
def control(
    session: Session,
    run: Run = Path("run"),
    loss: LossOption = "OBJ1",
    target: Target = None,
    key: Annotated[
        Optional[list[float]],  # noqa: UP045
        typer.Option(help="The arc length [m] of a key point to predict. Repeatable."),
    ] = None,
    turn: Annotated[
        Optional[bool],  # noqa: UP045
        typer.Option(
            "--turn/--no-turn",
            help="Move the gripper's orientation too; by default in shape control only.",
        ),
    ] = None,
    evaluations: Annotated[
        int,
        typer.Option(help="The most evaluations of the search.", rich_help_panel=OF_EXPERTS),
    ] = 200,
    force: Force = False,
) -> None:
    """Find where the control point was, or where it must go.

    It is estimated in every frame, or found for target points that the rope is to pass.
    """
    from ropefit.api import runs

    settings = {
        "loss": loss,
        "key": list(key or []),
        "turn": turn,
        "evaluations": evaluations,
    }
    outcome = runs.control(run, settings, session.context("control"), target, force)
    session.result(show_control(session, outcome))


def show_control(session: Session, outcome: Outcome[Control]) -> dict[str, Any]:
    """Print how far off the control point is, and return the summary."""
    from ropefit.api.summaries import controlled

    session.finished("control", outcome)
    c = outcome.artifact
    rows = []
    if c.kind == "estimate":
        rows.append(["control point", *_spread(c.deviation, c.deviation_px)])
        for k in range(c.key_arc.shape[1]):
            label = f"key point at {c.key_arc[0, k]:.3g} m"
            rows.append([label, *_spread(c.key_deviation[:, k], c.key_deviation_px[:, k])])
    else:
        for case in range(len(c.cases)):
            at = ", ".join(f"{value:.4f}" for value in c.position[case])
            label = f"target {c.cases[case]}: gripper to ({at}) m"
            rows.append([label, *_spread(c.key_deviation[case], c.key_deviation_px[case])])
    session.table(
        f"{c.kind} by {c.loss_name}: deviation",
        ["", "median [mm]", "mean [mm]", "max [mm]", "mean [px]"],
        rows,
    )
    session.say(f"{int(c.converged.sum())} of {len(c.cases)} searches converged")
    for note in c.notes:
        session.say(f"note: {note}")
    return controlled(outcome)


def _spread(metres: np.ndarray, pixels: np.ndarray) -> list[str]:
    """Return median, mean and largest in mm, mean in pixels."""
    import numpy as np

    known = metres[np.isfinite(metres)] * 1e3
    if known.size == 0:
        return ["-", "-", "-", "-"]
    values = [np.median(known), known.mean(), known.max(), np.nanmean(pixels)]
    return [f"{value:.3g}" for value in values]
