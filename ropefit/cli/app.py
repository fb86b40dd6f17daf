"""All commands, in the groups that `ropefit --help` shows."""

from __future__ import annotations

from typing import Annotated

import typer

from ropefit.cli.batch import batch
from ropefit.cli.control import control
from ropefit.cli.diagnose import diagnose
from ropefit.cli.export import export
from ropefit.cli.grouped import GroupedCommand, GroupedCommands
from ropefit.cli.identify import identify
from ropefit.cli.importing import import_
from ropefit.cli.inspect import inspect
from ropefit.cli.preprocess import preprocess
from ropefit.cli.report import report
from ropefit.cli.run import run
from ropefit.cli.simulate import simulate
from ropefit.cli.startup import lighten
from ropefit.cli.view import view
from ropefit.cli.warm_up import warm_up

EVERYDAY = "Everyday commands"
PAPER = "The paper's stages, one by one"
EXPERT = "For experts"

app = typer.Typer(
    name="ropefit",
    cls=GroupedCommands,
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
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    pass


for group, commands in {
    EVERYDAY: (run, import_, diagnose, report, view, export),
    PAPER: (preprocess, identify, control),
    EXPERT: (batch, inspect, simulate, warm_up),
}.items():
    for command in commands:
        name = command.__name__.rstrip("_").replace("_", "-")
        app.command(name, cls=GroupedCommand, rich_help_panel=group)(command)


def main() -> None:
    """Run the `ropefit` command."""
    lighten()
    app()
