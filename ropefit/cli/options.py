"""The options that commands share, as typer reads them."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Optional, get_type_hints

import typer

Search = StrEnum("Search", ["gradient", "grid", "least-squares"])
Device = StrEnum("Device", ["cpu", "cuda"])
ProjectChoice = StrEnum("ProjectChoice", ["auto", "yes", "no"])
UntilStage = StrEnum("UntilStage", ["preprocess", "identify", "diagnose", "control", "report"])
Engine = StrEnum("Engine", ["local", "dask"])


def _solvers() -> list[str]:
    from ropefit.solvers.names import solver_names

    return solver_names()


def _solver(name: str) -> str:
    from ropefit.solvers.names import known_solver

    return _refusing(known_solver, name)


def _losses() -> list[str]:
    from ropefit.losses.names import loss_names

    return loss_names()


def _loss(name: str) -> str:
    from ropefit.losses.names import known_loss

    return _refusing(known_loss, name)


def _refusing(known: Callable[[str], str], name: str) -> str:
    """Return a name that there is; else the command is refused with those there are."""
    from ropefit.errors import WrongUsage

    try:
        return known(name)
    except WrongUsage as error:
        raise typer.BadParameter(str(error).partition(": ")[2])


OptionalPath = Optional[Path]  # noqa: UP045 (typer reads these)
OptionalFloat = Optional[float]  # noqa: UP045
OptionalText = Optional[str]  # noqa: UP045
Texts = Optional[list[str]]  # noqa: UP045

# The groups of a command's options; those of none are for everyday use.
OF_PICTURES = "Options for pictures"
OF_PAPER = "Options of the paper's solvers"
OF_EXPERTS = "Options for experts"
OF_OUTPUT = "Options of the output"

Run = Annotated[
    Path, typer.Option("--run", help="The run directory: what is computed is kept there.")
]
_OUTPUT = {
    "json": Annotated[
        bool,
        typer.Option(
            "--json", help="Print one JSON object on standard output.", rich_help_panel=OF_OUTPUT
        ),
    ],
    "quiet": Annotated[
        bool, typer.Option("--quiet", "-q", help="Print errors only.", rich_help_panel=OF_OUTPUT)
    ],
    "debug": Annotated[
        bool,
        typer.Option("--debug", help="Show the traceback of an error.", rich_help_panel=OF_OUTPUT),
    ],
}
Force = Annotated[bool, typer.Option("--force", help="Compute again what is up to date.")]
ForceOther = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Compute again what is up to date, also where the run holds another recording.",
    ),
]
RecordingPath = Annotated[
    OptionalPath,
    typer.Argument(help="The recording directory. Without one the packaged sample is used."),
]
Nodes = Annotated[int, typer.Option(help="The number K of particles along the rope.")]
Project = Annotated[
    ProjectChoice,
    typer.Option(help="Whether points are projected onto the plane of gravity and the two ends."),
]
RopeColor = Annotated[
    OptionalText,
    typer.Option(
        "--color",
        help="The rope's colour in the pictures, as r,g,b of 0..255 or as #rrggbb.",
        rich_help_panel=OF_PICTURES,
    ),
]
Roi = Annotated[
    OptionalText,
    typer.Option(
        help="The part of the pictures that holds the rope, as u,v,width,height [px].",
        rich_help_panel=OF_PICTURES,
    ),
]
Mask = Annotated[
    OptionalPath,
    typer.Option(
        help="A folder of masks, one image a frame, the rope where it is not black; frames "
        "without one are excluded.",
        rich_help_panel=OF_PICTURES,
    ),
]
DebugImages = Annotated[
    OptionalPath,
    typer.Option(
        help="A folder to write every intermediate picture into.", rich_help_panel=OF_PICTURES
    ),
]
SolverOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        autocompletion=_solvers,
        callback=_solver,
        help="The model of the rope: the rod in equilibrium, the rod in motion (dynamics), or one "
        "of the paper's solvers (jacobi, thomas), or an add-on's.",
    ),
]
LOSSES = (
    "It is a sum of distances between the rope as recorded and as simulated. In space: OBJ1, from "
    "each recorded point to the nearest point of the rope; OBJ4, from the ends of the recorded "
    "segments to the particles of the same numbers; OBJ7, from each recorded point to the segment "
    "of the same number. OBJ2, OBJ5 and OBJ8 are the same in the image; OBJ3, OBJ6 and OBJ9 add to "
    "these the distance of the lowest points."
)
LossOption = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        autocompletion=_losses,
        callback=_loss,
        help=f"The loss that is minimised: OBJ1 to OBJ9, or an add-on's. {LOSSES}",
    ),
]
SearchOption = Annotated[
    Optional[Search],  # noqa: UP045
    typer.Option(
        help="How parameters are searched. By default: least-squares for a rod, gradient for the "
        "paper's solvers."
    ),
]
DeviceOption = Annotated[
    Device,
    typer.Option(
        help="Where a grid or gradient search in equilibrium settles its ropes.",
        rich_help_panel=OF_EXPERTS,
    ),
]
ControlAt = Annotated[
    OptionalFloat,
    typer.Option(
        help="The arc length of the control point [m]; by default it is end 0.",
        rich_help_panel=OF_PAPER,
    ),
]
Target = Annotated[
    OptionalPath,
    typer.Option(
        help="A csv of target points x,y,z[,arc_length][,target] that the rope is to pass: "
        "shape control."
    ),
]
NominalRun = Annotated[
    OptionalPath,
    typer.Option(help="Another run of the same rope, whose parameters are taken as known."),
]
CalibrationRun = Annotated[
    OptionalPath,
    typer.Option(
        help="A run of the same set-up, best of a taut rope, whose camera and gravity are taken as "
        "known."
    ),
]
MostFrames = Annotated[int, typer.Option(help="The most frames that the fit uses.")]
TARGETS = ("mujoco", "mujoco3", "newton", "pyelastica", "json")
FORMATS = ("clouds", "tum", "ros", "realsense", "kinect", "video", "lerobot", "mocap", "c3d")


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Return a function of a session and options as a command, which owns the terminal while it
    runs; it has --json, --quiet and --debug as every command."""

    @functools.wraps(function)
    def run(json: bool = False, quiet: bool = False, debug: bool = False, **options: Any) -> None:
        from ropefit.cli.console import Session

        with Session(json, quiet, debug) as session:
            function(session, **options)

    # `Session` is imported when a command runs; typer reads the others.
    hints = get_type_hints(function, localns={"Session": Any}, include_extras=True)
    own = list(inspect.signature(function).parameters.values())[1:]
    output = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in _OUTPUT.items()
    ]
    read = [*(p.replace(annotation=hints[p.name]) for p in own), *output]
    run.__signature__ = inspect.Signature(read)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in read}
    return run
