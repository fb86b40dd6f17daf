"""The command line: options in, stage called, result told. No logic, and no heavy import before a
command."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

app = typer.Typer(
    name="ropefit",
    help="Turn recordings of real ropes into simulations that behave like them.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Solver(StrEnum):
    """The paper's solvers, or the rod in equilibrium."""

    jacobi = "jacobi"
    thomas = "thomas"
    equilibrium = "equilibrium"


class Search(StrEnum):
    """How the parameters are searched."""

    gradient = "gradient"
    grid = "grid"
    least_squares = "least-squares"


class ProjectChoice(StrEnum):
    """Whether points are projected onto the plane of gravity and the two ends."""

    auto = "auto"
    yes = "yes"
    no = "no"


Loss = StrEnum("Loss", [(f"OBJ{i}", f"OBJ{i}") for i in range(1, 10)])

Run = Annotated[Path, typer.Option("--run", help="Run directory.", show_default=True)]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks.")]
Force = Annotated[bool, typer.Option("--force", help="Compute even what is up to date.")]
RecordingPath = Annotated[
    Optional[Path],  # noqa: UP045 (typer reads it)
    typer.Argument(help="Recording directory; the packaged sample if none is given."),
]
Nodes = Annotated[int, typer.Option(help="K: particles of the rope.")]
Project = Annotated[
    ProjectChoice, typer.Option(help="Project points onto the plane of gravity and the two ends.")
]
SolverOption = Annotated[
    Solver, typer.Option(help="The paper's solvers, or the rod in equilibrium.")
]
LossOption = Annotated[Loss, typer.Option(help="Loss to fit.")]  # type: ignore[valid-type]
SearchOption = Annotated[
    Optional[Search],  # noqa: UP045
    typer.Option(help="How to search; least-squares for equilibrium, else gradient, if not given."),
]
ControlAt = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(help="Arc length of the control point [m]; end 0 if not given."),
]


def _version(show: bool) -> None:
    if show:
        from ropefit import __version__

        typer.echo(f"ropefit {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


def _session(json: bool, quiet: bool, debug: bool) -> Any:
    from ropefit.console import Session

    return Session(json=json, quiet=quiet, debug=debug)


@app.command()
def run(
    recording: RecordingPath = None,
    run: Run = Path("run"),
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    solver: SolverOption = Solver.equilibrium,
    loss: LossOption = Loss.OBJ1,  # type: ignore[attr-defined]
    search: SearchOption = None,
    control_at: ControlAt = None,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Every stage, then the report."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import run_all

        session.result(
            run_all(
                session,
                recording,
                run,
                {"nodes": nodes, "project": project.value},
                {
                    "solver": solver.value,
                    "loss": loss.value,
                    "search": search.value if search else None,
                    "control_at": control_at,
                },
                {"loss": loss.value},
                force,
            )
        )


@app.command()
def preprocess(
    recording: RecordingPath = None,
    run: Run = Path("run"),
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    most_points: Annotated[int, typer.Option(help="Points kept per frame.")] = 400,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Order, segment and project the recorded points; measure their noise."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import preprocess

        settings = {"nodes": nodes, "project": project.value, "most_points": most_points}
        session.result(preprocess(session, recording, run, settings, force))


@app.command()
def identify(
    run: Run = Path("run"),
    solver: SolverOption = Solver.equilibrium,
    loss: LossOption = Loss.OBJ1,  # type: ignore[attr-defined]
    search: SearchOption = None,
    free: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            help="Comma-separated parameters to fit: EI,GJ,EA,length, or weights of the paper."
        ),
    ] = None,
    start: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(help="NAME=VALUE: where a parameter starts (stays, if not free); repeatable."),
    ] = None,
    from_run: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--from",
            help="Run whose parameters are kept (equilibrium); those of --free are fitted still.",
        ),
    ] = None,
    groups: Annotated[
        str, typer.Option(help="Parameter sets: one, tension, or frame ranges like 0-17,18-35.")
    ] = "one",
    two_sided: Annotated[
        bool, typer.Option(help="A gravity weight for each side of the control point.")
    ] = False,
    control_at: ControlAt = None,
    steps: Annotated[int, typer.Option(help="Gravity steps of Algorithm 1.")] = 50,
    iterations: Annotated[int, typer.Option(help="Constraint iterations per step.")] = 20,
    dt: Annotated[float, typer.Option(help="Time step of the gravity prediction [s].")] = 0.1,
    compliance: Annotated[
        str, typer.Option(help="XPBD compliances: shear, bend, distance; 0 is a hard constraint.")
    ] = "0,0,0",
    evaluations: Annotated[int, typer.Option(help="Most evaluations of a gradient search.")] = 60,
    levels: Annotated[int, typer.Option(help="Grid search: values per weight.")] = 3,
    rounds: Annotated[int, typer.Option(help="Grid search: refinements.")] = 3,
    holdout: Annotated[float, typer.Option(help="Share of frames held out, in blocks.")] = 0.2,
    most_frames: Annotated[int, typer.Option(help="Most frames used by the fit.")] = 60,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Find the parameters that make simulation and recording agree."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import identify, parse_numbers, parse_start

        settings = {
            "solver": solver.value,
            "loss": loss.value,
            "search": search.value if search else None,
            "free": free.split(",") if free else None,
            "start": parse_start(start or []),
            "groups": groups,
            "two_sided": two_sided,
            "control_at": control_at,
            "steps": steps,
            "iterations": iterations,
            "dt": dt,
            "compliance": parse_numbers("--compliance", compliance, 3),
            "evaluations": evaluations,
            "levels": levels,
            "rounds": rounds,
            "holdout": holdout,
            "most_frames": most_frames,
        }
        session.result(identify(session, run, settings, from_run, force))


@app.command()
def control(
    run: Run = Path("run"),
    loss: LossOption = Loss.OBJ1,  # type: ignore[attr-defined]
    target: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(help="csv of target points x,y,z[,arc_length][,target]: shape control."),
    ] = None,
    key: Annotated[
        Optional[list[float]],  # noqa: UP045
        typer.Option(help="Arc length [m] of a key point to predict; repeatable."),
    ] = None,
    turn: Annotated[
        Optional[bool],  # noqa: UP045
        typer.Option(
            "--turn/--no-turn",
            help="Move the gripper's orientation too (default: in shape control only).",
        ),
    ] = None,
    evaluations: Annotated[int, typer.Option(help="Most evaluations of the search.")] = 200,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Where the control point was in every frame, or where it must go to reach target points."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import control

        settings = {
            "loss": loss.value,
            "key": list(key or []),
            "turn": turn,
            "evaluations": evaluations,
            "target": target is not None,
        }
        session.result(control(session, run, settings, target, force))


@app.command()
def report(
    run: Run = Path("run"), json: Json = False, quiet: Quiet = False, debug: Debug = False
) -> None:
    """Write report.html: one offline page on everything the run holds."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import report

        session.result(report(session, run))


@app.command()
def inspect(
    path: Annotated[Path, typer.Argument(help="An artifact or a run directory.")],
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """What is in an artifact or run, valid or why not."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import inspect

        session.result(inspect(session, path))


@app.command()
def simulate(
    spec: Annotated[Path, typer.Argument(help="TOML description, see docs/simulate.md.")],
    out: Annotated[Path, typer.Option("--out", help="Recording directory to write.")],
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Make a synthetic recording: chosen path of the ends, noise, occlusion."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import simulate

        session.result(simulate(session, spec, out))


def main() -> None:
    """Entry point of the `ropefit` command."""
    app()
