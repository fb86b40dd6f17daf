"""`ropefit report`: one page on a run, or one that compares runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from ropefit.cli.options import Force, OptionalPath, Run, command

if TYPE_CHECKING:
    from ropefit.cli.console import Session

Runs = Annotated[
    Optional[list[Path]],  # noqa: UP045 (typer reads it)
    typer.Argument(help="A run directory, or several to compare."),
]


@command
def report(
    session: Session,
    runs: Runs = None,
    run: Run = Path("run"),
    png: Annotated[
        bool, typer.Option("--png", help="Write the figures too, as PNG in the folder figures.")
    ] = False,
    svg: Annotated[bool, typer.Option("--svg", help="Write the figures too, as SVG.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Write the figures too, as PDF.")] = False,
    out: Annotated[
        OptionalPath,
        typer.Option(help="The comparison to write; by default comparison.html."),
    ] = None,
    force: Force = False,
) -> None:
    """Write report.html, one offline page, or compare several runs."""
    from ropefit.errors import WrongUsage
    from ropefit.stages.report import compare_runs

    given = runs or []
    kinds = [name for name, on in (("png", png), ("svg", svg), ("pdf", pdf)) if on]
    if len(given) > 1:
        if kinds:
            raise WrongUsage(f"--{kinds[0]}: figures are written for one run at a time")
        page = compare_runs(given, out or Path("comparison.html"))
        session.say(f"report: {page} compares {len(given)} runs")
        session.result(
            {"stage": "report", "report": str(page), "runs": [str(path) for path in given]}
        )
        return
    if out is not None:
        raise WrongUsage("--out belongs to a comparison: give two runs or more")
    session.result(show_report(session, given[0] if given else run, kinds, force))


def show_report(
    session: Session, run: Path, kinds: list[str], force: bool = False
) -> dict[str, Any]:
    """Write the page and the figures of a run, say where they are, and return that."""
    from ropefit.runs.run_directory import existing_run
    from ropefit.stages.report import print_report, write_report

    page = write_report(existing_run(run), session.say, force)
    session.say(f"report: {page}")
    data: dict[str, Any] = {"stage": "report", "report": str(page)}
    if kinds:
        figures = print_report(run, kinds, session.progress("figures"))
        session.finish()
        session.say(f"report: {len(figures)} figures in {run / 'figures'}")
        data["figures"] = [str(path) for path in figures]
    return data
