"""`ropefit batch`: every stage of many recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ropefit.cli.options import (
    Engine,
    LossOption,
    MostFrames,
    Nodes,
    OptionalText,
    Project,
    ProjectChoice,
    SearchOption,
    SolverOption,
    UntilStage,
    command,
)

if TYPE_CHECKING:
    from ropefit.batch import Batch
    from ropefit.cli.console import Session

SHOWN_ROWS = 40  # of the table on a terminal


@command
def batch(
    session: Session,
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings, or folders with recordings below them.")
    ],
    runs: Annotated[
        Path, typer.Option("--runs", help="The folder to write a run for each recording into.")
    ],
    until: Annotated[
        UntilStage, typer.Option(help="The last stage to compute.")
    ] = UntilStage.report,
    engine: Annotated[
        Engine,
        typer.Option(
            help="Where it runs: processes of this machine, or the workers of a dask scheduler."
        ),
    ] = Engine.local,
    scheduler: Annotated[
        OptionalText,
        typer.Option(help="The address of the dask scheduler, like tcp://10.0.0.1:8786."),
    ] = None,
    workers: Annotated[
        Optional[int],  # noqa: UP045 (typer reads it)
        typer.Option(
            min=1,
            help="How many recordings are computed at a time on this machine; by default as many "
            "as it has processors.",
        ),
    ] = None,
    retry: Annotated[
        bool, typer.Option(help="Compute again the recordings that failed before.")
    ] = False,
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    solver: SolverOption = "equilibrium",
    loss: LossOption = "OBJ1",
    search: SearchOption = None,
    most_frames: MostFrames = 60,
) -> None:
    """Compute every stage of many recordings, with one index.

    Recordings that fail are kept apart and do not stop the others.
    """
    from ropefit.batch import run_batch
    from ropefit.batch.index import summary

    settings = {
        "preprocess": {"nodes": nodes, "project": project.value},
        "identify": {
            "solver": solver,
            "loss": loss,
            "search": search.value if search else None,
            "most_frames": most_frames,
        },
        "control": {"loss": loss},
    }
    done = run_batch(
        recordings,
        runs,
        settings,
        str(until),
        str(engine),
        scheduler,
        workers,
        retry,
        session.context("batch"),
    )
    session.finish()
    _show(session, done)
    session.result(summary(done))
    done.check()


def _show(session: Session, done: Batch) -> None:
    """Print a table of the recordings, those that are not done first."""
    from ropefit.batch.index import BRIEF, HEAD, cells

    ordered = sorted(done.records, key=lambda r: r.state == "done")
    rows = [[cells(r)[column] for column in BRIEF] for r in ordered[:SHOWN_ROWS]]
    session.table(f"{done.runs}", [HEAD[column] for column in BRIEF], rows)
    for r in ordered[:SHOWN_ROWS]:
        if r.state != "done":
            session.say(f"{r.name}: {r.message}")
    if len(ordered) > SHOWN_ROWS:
        session.say(f"{len(ordered) - SHOWN_ROWS} more in {done.runs / 'summary.csv'}")
    text = ", ".join(f"{count} {state}" for state, count in done.counts().items() if count)
    session.say(f"batch: {text}; all numbers in {done.runs / 'index.html'} and summary.csv")
