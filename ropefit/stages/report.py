"""report: one HTML page from the artifacts of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ropefit.adapters.contents import read_run
from ropefit.artifacts import Control, Diagnosis, Exports, Model
from ropefit.artifacts.atomic import write_bytes
from ropefit.errors import StageFailed, WrongUsage
from ropefit.runs.lock import working_on
from ropefit.runs.protocol import Progress
from ropefit.runs.run_directory import REPORT, existing_run


def write_report(directory: Path, say: Callable[[str], None]) -> Path:
    """Write report.html of a run and return its path.

    Raises StageFailed when there are no observations or an artifact is stale, BadInput when one is
    damaged. A kill at any instant leaves the old page or the new one.
    """
    from ropefit.reporting.report import render_report

    run = read_run(directory)
    parts = ((Model, run.model), (Control, run.control), (Diagnosis, run.diagnosis))
    missing = [kind.file_name for kind, part in parts if part is None]
    if missing:
        say(f"the report has no part on {' and '.join(missing)}: not in this run")
    if run.exports is None and (directory / Exports.file_name).exists():
        say(f"{Exports.file_name} was made from an earlier fit and is not shown; export again")
    path = directory / REPORT
    text = render_report(run)
    with working_on(directory):
        _write(path, text)
    return path


def print_report(
    directory: Path, kinds: list[str], progress: Progress = lambda share, text: None
) -> list[Path]:
    """Return every figure of a run's report as svg, pdf or png in its folder `figures`.

    Raises StageFailed where matplotlib is missing or nothing can be written.
    """
    from ropefit.reporting.printed import print_figures
    from ropefit.reporting.report import figures_of

    figures = figures_of(read_run(directory))
    return print_figures(figures, directory / "figures", kinds, progress)


def compare_runs(directories: list[Path], out: Path) -> Path:
    """Return one page on several runs. Raises StageFailed, WrongUsage."""
    from ropefit.reporting.comparison import render_comparison

    names = [directory.absolute().name for directory in directories]
    if len(set(names)) < len(names):
        names = [str(directory) for directory in directories]
    if len(set(names)) < len(names):
        raise WrongUsage("the same run is given twice; give different ones")
    if out.is_dir():
        raise WrongUsage(f"{out}: is a folder; give a file as --out")
    runs = [read_run(existing_run(directory)) for directory in directories]
    _write(out, render_comparison(list(zip(names, runs, strict=True))))
    return out


def _write(path: Path, text: str) -> None:
    try:
        write_bytes(path, text.encode())
    except OSError as error:
        raise StageFailed(
            f"cannot write {path}: {error.strerror}; free space or give another place"
        )
