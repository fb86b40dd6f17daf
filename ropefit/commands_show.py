"""What the commands do that show a run to people: report, comparison, viewers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ropefit.console import Session
from ropefit.errors import WrongUsage
from ropefit.runs.run_directory import existing_run


def report(
    session: Session, runs: list[Path], run: Path, kinds: list[str], out: Path | None
) -> dict[str, Any]:
    """One run -> its report.html (and figures); several -> one page that compares them."""
    from ropefit.stages.report import compare_runs, print_report, write_report

    if len(runs) > 1:
        if kinds:
            raise WrongUsage(f"--{kinds[0]}: figures are written for one run at a time")
        page = compare_runs(runs, out or Path("comparison.html"))
        session.say(f"report: {page} compares {len(runs)} runs")
        return {"stage": "report", "report": str(page), "runs": [str(path) for path in runs]}
    if out is not None:
        raise WrongUsage("--out belongs to a comparison: give two runs or more")
    run = existing_run(runs[0] if runs else run)
    page = write_report(run, session.say)
    session.say(f"report: {page}")
    data: dict[str, Any] = {"stage": "report", "report": str(page)}
    if kinds:
        progress = session.progress("figures")
        figures = print_report(run, kinds, progress)
        session.finish()
        session.say(f"report: {len(figures)} figures in {run / 'figures'}")
        data["figures"] = [str(path) for path in figures]
    return data


def tell_answer(session: Session, run: Path) -> list[str]:
    """The answer in three sentences, at the end of a run."""
    from ropefit.adapters.contents import read_run
    from ropefit.reporting.answer import answer

    sentences = answer(read_run(run))
    session.answer(sentences)
    return sentences


def view(session: Session, run: Path, out: Path | None, serve: bool, port: int) -> dict[str, Any]:
    """A run as a rerun recording file, or served by viser until it is stopped."""
    from ropefit.adapters.contents import read_run

    contents = read_run(existing_run(run))
    if serve:
        from ropefit.viewing.viser import serve_run

        serve_run(contents, port, session.say)
        return {"stage": "view", "port": port}
    from ropefit.viewing.rerun import write_rerun

    path = write_rerun(contents, out or run / "view.rrd")
    session.say(f"view: {path} written; open it with: rerun {path}")
    return {"stage": "view", "file": str(path)}
