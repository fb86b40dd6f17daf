"""`ropefit diagnose`: where simulation and recording differ, and which physics is missing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ropefit.cli.options import (
    OF_EXPERTS,
    CalibrationRun,
    Force,
    NominalRun,
    OptionalPath,
    Run,
    command,
)

if TYPE_CHECKING:
    from ropefit.artifacts import Diagnosis
    from ropefit.artifacts.causes import Size
    from ropefit.artifacts.diagnosis import Simulation
    from ropefit.cli.console import Session
    from ropefit.runs.protocol import Outcome


@command
def diagnose(
    session: Session,
    run: Run = Path("run"),
    nominal: NominalRun = None,
    calibration: CalibrationRun = None,
    simulation: Annotated[
        OptionalPath,
        typer.Option(
            help="A run of your simulator's recording of the same motion: what it is, and what it "
            "lacks."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(help="The seed of the simulated recordings.", rich_help_panel=OF_EXPERTS),
    ] = 0,
    most_frames: Annotated[
        int,
        typer.Option(
            help="The most frames that are used, evenly spread.", rich_help_panel=OF_EXPERTS
        ),
    ] = 48,
    evaluations: Annotated[
        int,
        typer.Option(
            help="The evaluations of the model after which a search at rest ends.",
            rich_help_panel=OF_EXPERTS,
        ),
    ] = 1200,
    force: Force = False,
) -> None:
    """Find where model and recording differ: the missing physics."""
    from ropefit.api import runs

    settings = {"seed": seed, "most_frames": most_frames, "evaluations": evaluations}
    context = session.context("diagnose")
    outcome = runs.diagnose(run, settings, context, nominal, calibration, force, simulation)
    session.result(show_diagnosis(session, outcome))


def show_diagnosis(session: Session, outcome: Outcome[Diagnosis]) -> dict[str, Any]:
    """Print what was diagnosed, and return its summary."""
    from ropefit.api.summaries import diagnosed
    from ropefit.reporting.next_step import next_step

    session.finished("diagnose", outcome)
    d = outcome.artifact
    if d.verdict == "none":
        session.say("no missing physics: what the nominal model does not explain is noise")
        if linearity := d.unseen("linearity"):
            session.say(linearity)
    elif d.verdict == "unknown":
        session.say(
            "something is missing that no effect of the catalogue explains; the report shows where"
        )
    rows = _rows(d)
    if rows:
        session.table(
            f"{d.recording}: what the model lacks",
            ["effect", "where [m]", "size (95 %)", "not ruled out", "evidence"],
            rows,
        )
        for c in d.causes.values():
            session.say(c.sentence)
    if d.simulation:
        _show_simulation(session, d.simulation)
    before = "simulation" if d.simulation else "nominal model"
    after = f", {d.rms_after * 1e3:.3g} mm with what was found" if d.causes else ""
    session.say(
        f"held-out frames: rms {d.rms_before * 1e3:.3g} mm by the {before}{after}; noise of a "
        f"point {d.noise_white * 1e3:.3g} mm"
    )
    for reason in d.refused:
        session.say(f"not accepted: {reason}")
    if advice := next_step(d):
        session.say(advice)
    return diagnosed(outcome)


def _show_simulation(session: Session, s: Simulation) -> None:
    """Print which rope a simulation is, and what it does besides."""
    rope = ", ".join(size_text(name, size) for name, size in s.rope.items())
    session.say(f"{s.name}: rms {s.rms * 1e3:.3g} mm from the recording; it simulates {rope}")
    for c in s.effects.values():
        session.say(f"in the simulation: {c.sentence}")
    session.say(f"the simulation lacks: {', '.join(s.missing) or 'nothing that was found'}")
    for difference in s.differences:
        session.say(difference)
    for reason in s.refused:
        session.say(f"in the simulation, not accepted: {reason}")
    session.say(
        f"that rope is {s.rms_of_rope * 1e3:.3g} mm from the simulation (held-out frames), with "
        f"these effects {s.rms_explained * 1e3:.3g} mm"
    )


def _rows(d: Diagnosis) -> list[list[str]]:
    """Return a row an effect: its name, its place, its size, its equivalents, its evidence."""
    from ropefit.reporting.words import strength

    rows = []
    for c in d.causes.values():
        whole = c.arc_length == (0.0, d.node_arc[-1])
        where = (
            "-"
            if c.arc_length is None or whole
            else f"{c.arc_length[0]:.3f} .. {c.arc_length[1]:.3f}"
        )
        key, size = next(iter(c.parameters.items()))
        others = ", ".join(c.equivalent_to) or "-"
        evidence = f"{strength(c.log_evidence, d.threshold)} ({c.log_evidence:.4g} nats)"
        rows.append([c.name, where, size_text(key, size), others, evidence])
    return rows


def size_text(key: str, size: Size) -> str:
    """Return a size with its interval and its unit."""
    from ropefit.reporting.words import digits_of

    digits = digits_of(size.ci95, 3)
    low, high = (f"{v:.{digits}g}" for v in size.ci95)
    unit = "" if size.unit == "1" else f" {size.unit}"
    return f"{key} {size.value:.{digits}g} ({low} .. {high}){unit}"
