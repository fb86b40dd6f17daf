"""The command that works on many recordings: options only, as in cli.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ropefit.cli_options import (
    Debug,
    Engine,
    Json,
    Loss,
    LossOption,
    Nodes,
    Project,
    ProjectChoice,
    Quiet,
    SearchOption,
    Solver,
    SolverOption,
    UntilStage,
    start_session,
)


def batch(
    recordings: Annotated[
        list[Path], typer.Argument(help="Recordings, or folders with recordings below them.")
    ],
    runs: Annotated[Path, typer.Option("--runs", help="Folder to write a run for each into.")],
    until: Annotated[UntilStage, typer.Option(help="Last stage.")] = UntilStage.report,
    engine: Annotated[
        Engine, typer.Option(help="Processes of this machine, or the workers of a dask scheduler.")
    ] = Engine.local,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of the dask scheduler, like tcp://10.0.0.1:8786."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Recordings at a time, local; as many as processors by default."),
    ] = None,
    retry: Annotated[bool, typer.Option(help="Compute those that failed before again.")] = False,
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    solver: SolverOption = Solver.equilibrium,
    loss: LossOption = Loss.OBJ1,  # type: ignore[attr-defined]
    search: SearchOption = None,
    most_frames: Annotated[int, typer.Option(help="Most frames used by the fit.")] = 60,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Every stage of many recordings, side by side; failures apart; one index of all."""
    with start_session(json, quiet, debug) as session:
        from ropefit.batch import run_batch

        settings = {
            "preprocess": {"nodes": nodes, "project": project.value},
            "identify": {
                "solver": solver.value,
                "loss": loss.value,
                "search": search.value if search else None,
                "most_frames": most_frames,
            },
            "control": {"loss": loss.value},
        }
        session.result(
            run_batch(
                session,
                recordings,
                runs,
                settings,
                until.value,
                engine.value,
                scheduler,
                workers,
                retry,
            )
        )
