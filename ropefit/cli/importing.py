"""`ropefit import`: a source of another format becomes a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ropefit.cli.options import FORMATS, OptionalFloat, OptionalPath, Texts, command

if TYPE_CHECKING:
    from ropefit.cli.console import Session

Format = Annotated[
    str,
    typer.Option(
        "--from",
        help=f"The format of the source: one of {', '.join(FORMATS)}.",
        autocompletion=lambda: list(FORMATS),
    ),
]


@command
def import_(
    session: Session,
    source: Annotated[
        Path, typer.Argument(help="The file or folder to read, see docs/importing.md.")
    ],
    format: Format,
    out: Annotated[OptionalPath, typer.Option("--out", help="The recording to write.")] = None,
    set_: Annotated[
        Texts, typer.Option("--set", help="NAME=VALUE: an option of the format. Repeatable.")
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="Only show what the source holds.")] = False,
    name: Annotated[
        str, typer.Option(help="The name of the recording; by default that of SOURCE.")
    ] = "",
    gravity: Annotated[
        str, typer.Option(help="Gravity x,y,z [m/s^2] in the recording's frame.")
    ] = "0,0,-9.81",
    length: Annotated[OptionalFloat, typer.Option(help="The rope's rest length [m].")] = None,
    diameter: Annotated[OptionalFloat, typer.Option(help="The rope's diameter [m].")] = None,
    mass: Annotated[OptionalFloat, typer.Option(help="The mass of the whole rope [kg].")] = None,
) -> None:
    """Make a recording of a bag, images, clouds or motion capture.

    docs/importing.md describes the formats and their options.
    """
    from ropefit.cli import parsing
    from ropefit.errors import WrongUsage
    from ropefit.importers import About
    from ropefit.stages.importing import import_recording

    if show:
        session.result(_listed(session, source, format))
        return
    if out is None:
        raise WrongUsage("--out is missing: the recording directory to write (or --list)")
    along = parsing.gravity(gravity)
    given = parsing.named_texts(set_ or [])
    about = About(name or source.stem or "imported", along, length, diameter, mass)
    progress = session.progress("import")
    data = import_recording(source, format, out, given, about, progress)
    session.finish()
    for note in data["notes"]:
        session.say(f"note: {note}")
    session.say(f"import: {out} written, {data['frames']} frames")
    session.result(data)


def _listed(session: Session, source: Path, format: str) -> dict[str, Any]:
    """Print what a source holds, and return it."""
    from ropefit.stages.importing import list_source

    data = list_source(source, format)
    rows = [[entry["name"], entry["kind"], str(entry["count"])] for entry in data["contents"]]
    session.table(str(source), ["name", "kind", "count"], rows)
    return data
