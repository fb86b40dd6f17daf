"""The command line: options in, stage called, result told. No logic, and no heavy import before a
command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from ropefit.cli_batch import batch
from ropefit.cli_options import (
    ControlAt,
    Debug,
    DebugImages,
    Device,
    DeviceOption,
    Force,
    Format,
    Json,
    Loss,
    LossOption,
    Mask,
    Nodes,
    OptionalFloat,
    OptionalPath,
    Project,
    ProjectChoice,
    Quiet,
    RecordingPath,
    Roi,
    RopeColor,
    Run,
    SearchOption,
    Solver,
    SolverOption,
    Target,
)
from ropefit.cli_options import start_session as _session
from ropefit.cli_show import report, view

app = typer.Typer(
    name="ropefit",
    help="Turn recordings of real ropes into simulations that behave like them.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


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
    color: RopeColor = None,
    roi: Roi = None,
    mask: Mask = None,
    debug_images: DebugImages = None,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Every stage, then the report."""
    with _session(json, quiet, debug) as session:
        from ropefit.adapters.picture_options import picture_settings
        from ropefit.commands import run_all

        session.result(
            run_all(
                session,
                recording,
                run,
                {
                    "nodes": nodes,
                    "project": project.value,
                    **picture_settings(color, roi, mask),
                },
                {
                    "solver": solver.value,
                    "loss": loss.value,
                    "search": search.value if search else None,
                    "control_at": control_at,
                },
                {"loss": loss.value},
                force,
                debug_images,
            )
        )


@app.command()
def preprocess(
    recording: RecordingPath = None,
    run: Run = Path("run"),
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    most_points: Annotated[int, typer.Option(help="Points kept per frame.")] = 400,
    color: RopeColor = None,
    roi: Roi = None,
    mask: Mask = None,
    debug_images: DebugImages = None,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Order, segment and project the recorded points; measure their noise."""
    with _session(json, quiet, debug) as session:
        from ropefit.adapters.picture_options import picture_settings
        from ropefit.commands import preprocess

        settings = {"nodes": nodes, "project": project.value, "most_points": most_points}
        settings |= picture_settings(color, roi, mask)
        session.result(preprocess(session, recording, run, settings, force, debug_images))


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
    device: DeviceOption = Device.cpu,
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
            "device": device.value,
        }
        session.result(identify(session, run, settings, from_run, force))


@app.command()
def diagnose(
    run: Run = Path("run"),
    nominal: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(help="Another run of the same rope: its rope is taken as known."),
    ] = None,
    calibration: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(help="A run of the same set-up, best of a taut rope: its camera, gravity."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the simulated clean recordings.")] = 0,
    most_frames: Annotated[int, typer.Option(help="Most frames used, evenly spread.")] = 48,
    force: Force = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Where simulation and recording differ, and which physics was left out."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands import diagnose

        settings = {"seed": seed, "most_frames": most_frames}
        session.result(diagnose(session, run, settings, nominal, calibration, force))


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


app.command()(batch)
app.command()(report)
app.command()(view)


@app.command()
def export(
    to: Target,
    out: Annotated[Path, typer.Option("--out", help="File to write.")],
    run: Run = Path("run"),
    mass: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(help="Mass of the whole rope [kg], if the recording does not say it."),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Let it come to rest in the simulator; measure how far off."),
    ] = False,
    python: Annotated[
        OptionalPath, typer.Option(help="Python that has the simulator [default: this one].")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """The identified rope, with what was left out, as text for a simulator."""
    with _session(json, quiet, debug) as session:
        from ropefit.commands_export import export

        session.result(export(session, run, to, out, mass, check, python))


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


@app.command("import")
def import_(
    source: Annotated[Path, typer.Argument(help="File or folder to read, see docs/importing.md.")],
    format: Format,
    out: Annotated[OptionalPath, typer.Option("--out", help="Recording to write.")] = None,
    set_: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--set", help="NAME=VALUE: an option of the format; repeatable."),
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="Only show what the source holds.")] = False,
    name: Annotated[str, typer.Option(help="Name of the recording [default: SOURCE's].")] = "",
    gravity: Annotated[str, typer.Option(help="x,y,z [m/s^2] in its frame.")] = "0,0,-9.81",
    length: Annotated[OptionalFloat, typer.Option(help="Rest length [m].")] = None,
    diameter: Annotated[OptionalFloat, typer.Option(help="Diameter [m].")] = None,
    mass: Annotated[OptionalFloat, typer.Option(help="Mass of the rope [kg].")] = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Make a recording out of a ROS bag, a TUM folder, point clouds or motion capture."""
    with _session(json, quiet, debug) as session:
        from ropefit.stages.importing import run_import

        about = {"length": length, "diameter": diameter, "mass": mass, "gravity": gravity}
        about["name"] = name or source.stem or "imported"
        session.result(run_import(session, source, format, out, set_ or [], show, about))


def main() -> None:
    """Entry point of the `ropefit` command."""
    app()
