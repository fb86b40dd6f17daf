"""The commands that show a run: options only, as in cli.py."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ropefit.cli_options import Debug, Json, OptionalPath, Quiet, Run, Runs, start_session


def report(
    runs: Runs = None,
    run: Run = Path("run"),
    png: Annotated[bool, typer.Option("--png", help="Figures too, as PNG in figures/.")] = False,
    svg: Annotated[bool, typer.Option("--svg", help="Figures too, as SVG.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Figures too, as PDF.")] = False,
    out: Annotated[
        OptionalPath, typer.Option(help="Comparison to write [default: comparison.html].")
    ] = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Write report.html: one offline page on everything the run holds; or compare runs."""
    with start_session(json, quiet, debug) as session:
        from ropefit.commands_show import report

        kinds = [name for name, on in (("png", png), ("svg", svg), ("pdf", pdf)) if on]
        session.result(report(session, runs or [], run, kinds, out))


def view(
    run: Run = Path("run"),
    out: Annotated[
        OptionalPath, typer.Option(help="Rerun recording to write [default: RUN/view.rrd].")
    ] = None,
    serve: Annotated[bool, typer.Option("--serve", help="Serve it by viser instead.")] = False,
    port: Annotated[int, typer.Option(help="Port of --serve on this machine.")] = 8080,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """The run in 3D: a file for rerun, or a server for the browser."""
    with start_session(json, quiet, debug) as session:
        from ropefit.commands_show import view

        session.result(view(session, run, out, serve, port))
