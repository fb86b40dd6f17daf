"""`ropefit export`: the identified rope as text for a simulator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ropefit.cli.options import TARGETS, OptionalFloat, OptionalPath, Run, command

if TYPE_CHECKING:
    from ropefit.api.runs import Exported
    from ropefit.cli.console import Session

Target = Annotated[
    str,
    typer.Option(
        "--to",
        help=f"The simulator: one of {', '.join(TARGETS)}, or an add-on's.",
        autocompletion=lambda: list(TARGETS),
    ),
]


@command
def export(
    session: Session,
    to: Target,
    out: Annotated[Path, typer.Option("--out", help="The file to write.")],
    run: Run = Path("run"),
    mass: Annotated[
        OptionalFloat,
        typer.Option(help="The mass of the whole rope [kg], if the recording does not say it."),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Let the rope come to rest in the simulator and measure how far off."
        ),
    ] = False,
    python: Annotated[
        OptionalPath,
        typer.Option(help="The Python that has the simulator; by default this one."),
    ] = None,
) -> None:
    """Write the identified rope for a simulator.

    The effects that were found go along where the simulator can express them.
    """
    from ropefit.api import runs
    from ropefit.api.summaries import exported

    made = runs.export(run, to, out, session.context("check"), mass, check, python)
    session.finish()
    _show_check(session, to, made)
    session.result(exported(made))


def _show_check(session: Session, target: str, made: Exported) -> None:
    """Print how far off the rope is in the simulator."""
    from ropefit.artifacts.exports import deviation
    from ropefit.exporters import exporter
    from ropefit.reporting.sections.exports import summary

    check = made.record.check
    if check is None:
        if exporter(target).simulator is not None:
            session.say(
                f"not tried in {target}: --check simulates it there and measures how far off it is"
            )
        return
    off = deviation(made.record, made.length)
    rows = [
        [str(frame), failure or f"{share:.3%}", _millimetres(share, made.length, failure)]
        for frame, failure, share in zip(made.record.frames, check.failures, off, strict=True)
    ]
    session.table(
        f"at rest in {check.simulator}: largest deviation from this simulation",
        ["frame", "of the rope's length", "[mm]"],
        rows,
    )
    session.say(summary(target, made.record, made.length))
    session.say("ropefit report puts this into the report")


def _millimetres(share: float, length: float, failure: str) -> str:
    return "-" if failure else f"{1e3 * share * length:.3g}"
