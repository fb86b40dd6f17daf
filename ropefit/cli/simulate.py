"""`ropefit simulate`: a synthetic recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ropefit.cli.options import Debug, Json, Quiet, start_session


def simulate(
    spec: Annotated[Path, typer.Argument(help="The description in TOML, see docs/simulate.md.")],
    out: Annotated[Path, typer.Option("--out", help="The recording directory to write.")],
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Simulate a recording: a path of the ends, noise, occlusion."""
    with start_session(json, quiet, debug) as session:
        from ropefit.recordings.manifest import read_toml

        read_toml(spec)  # refused before a solver is loaded
        from ropefit.solvers.compiling import telling
        from ropefit.stages.simulate import simulate_recording

        with telling(session.say):
            data = simulate_recording(spec, out, session.progress("simulate"), session.say)
        session.finish()
        session.say(f"simulate: {out} written, {data['frames']} frames")
        session.result(data)
