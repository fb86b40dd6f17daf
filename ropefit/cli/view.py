"""`ropefit view`: a run in 3D."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ropefit.cli.options import OptionalPath, Run, command

if TYPE_CHECKING:
    from ropefit.cli.console import Session


@command
def view(
    session: Session,
    run: Run = Path("run"),
    out: Annotated[
        OptionalPath,
        typer.Option(
            help="The file to write: .rrd for rerun, .mcap for Foxglove and ROS 2. "
            "By default RUN/view.rrd."
        ),
    ] = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Serve the run to the browser by viser instead.")
    ] = False,
    port: Annotated[int, typer.Option(help="The port of --serve on this machine.")] = 8080,
) -> None:
    """Show a run in 3D: as a file for rerun or Foxglove, or in the browser."""
    from ropefit.adapters.contents import read_run
    from ropefit.runs.run_directory import existing_run

    contents = read_run(existing_run(run))
    if serve:
        from ropefit.viewing.viser import serve_run

        serve_run(contents, port, session.say)
        session.result({"stage": "view", "port": port})
        return
    if out is not None and out.suffix == ".mcap":
        from ropefit.viewing.mcap import write_mcap

        path = write_mcap(contents, out)
        session.say(f"view: {path} written; open it in Foxglove")
        session.result({"stage": "view", "file": str(path)})
        return
    from ropefit.viewing.rerun import write_rerun

    path = write_rerun(contents, out or run / "view.rrd")
    session.say(f"view: {path} written; open it with: rerun {path}")
    session.result({"stage": "view", "file": str(path)})
