"""The options that commands share, as typer reads them."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Optional

import typer


class Solver(StrEnum):
    """The paper's solvers, the rod in equilibrium, or the rod in motion."""

    jacobi = "jacobi"
    thomas = "thomas"
    equilibrium = "equilibrium"
    dynamics = "dynamics"


class Search(StrEnum):
    """How the parameters are searched."""

    gradient = "gradient"
    grid = "grid"
    least_squares = "least-squares"


class Device(StrEnum):
    """Where many ropes are settled at once."""

    cpu = "cpu"
    cuda = "cuda"


class ProjectChoice(StrEnum):
    """Whether points are projected onto the plane of gravity and the two ends."""

    auto = "auto"
    yes = "yes"
    no = "no"


class UntilStage(StrEnum):
    """The stages of a run, in order."""

    preprocess = "preprocess"
    identify = "identify"
    diagnose = "diagnose"
    control = "control"
    report = "report"


class Engine(StrEnum):
    """Where a batch runs."""

    local = "local"
    dask = "dask"


Loss = StrEnum("Loss", [(f"OBJ{i}", f"OBJ{i}") for i in range(1, 10)])

OptionalPath = Optional[Path]  # noqa: UP045 (typer reads these)
OptionalFloat = Optional[float]  # noqa: UP045
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
RopeColor = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--color", help="The rope's colour in the pictures: r,g,b of 0..255, or #rrggbb."),
]
Roi = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(help="Part of the pictures that holds the rope: u,v,width,height [px]."),
]
Mask = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(help="Folder of masks, one image a frame, rope where not black."),
]
DebugImages = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(help="Folder to write every intermediate picture into."),
]
SolverOption = Annotated[
    Solver, typer.Option(help="The paper's solvers, the rod in equilibrium, or in motion.")
]
LossOption = Annotated[Loss, typer.Option(help="Loss to fit.")]  # type: ignore[valid-type]
SearchOption = Annotated[
    Optional[Search],  # noqa: UP045
    typer.Option(help="How to search; least-squares for equilibrium, else gradient, if not given."),
]
DeviceOption = Annotated[
    Device,
    typer.Option(help="Where a grid or gradient search settles its ropes (equilibrium)."),
]
ControlAt = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(help="Arc length of the control point [m]; end 0 if not given."),
]
Runs = Annotated[
    Optional[list[Path]],  # noqa: UP045
    typer.Argument(help="A run directory, or several to compare."),
]
_TARGETS = ("mujoco", "mujoco3", "newton", "pyelastica", "json")
_FORMATS = ("clouds", "tum", "ros", "realsense", "kinect", "mocap", "c3d")
Target = Annotated[
    str,
    typer.Option(
        "--to", help=f"One of {', '.join(_TARGETS)}.", autocompletion=lambda: list(_TARGETS)
    ),
]
Format = Annotated[
    str,
    typer.Option(
        "--from", help=f"One of {', '.join(_FORMATS)}.", autocompletion=lambda: list(_FORMATS)
    ),
]


def start_session(json: bool, quiet: bool, debug: bool) -> Any:
    """The command's terminal; imported when a command runs."""
    from ropefit.console import Session

    return Session(json=json, quiet=quiet, debug=debug)
