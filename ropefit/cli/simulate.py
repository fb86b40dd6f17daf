"""`ropefit simulate`: a synthetic recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ropefit.cli.options import command

if TYPE_CHECKING:
    from ropefit.cli.console import Session


@command
def simulate(
    session: Session,
    spec: Annotated[Path, typer.Argument(help="The description in TOML, see docs/simulate.md.")],
    out: Annotated[Path, typer.Option("--out", help="The recording directory to write.")],
) -> None:
    """Simulate a recording: a path of the ends, noise, occlusion."""
    from ropefit.recordings.manifest import read_toml

    read_toml(spec)  # refused before a solver is loaded
    from ropefit.solvers.compiling import telling
    from ropefit.stages.simulate import simulate_recording

    with telling(session.say):
        data = simulate_recording(spec, out, session.progress("simulate"), session.say)
    session.finish()
    session.say(f"simulate: {out} written, {data['frames']} frames")
    session.result(data)
