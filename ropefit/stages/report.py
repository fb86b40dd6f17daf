"""report: one HTML page from the artifacts of a run."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

from ropefit import __version__
from ropefit.adapters.contents import read_run
from ropefit.artifacts import ARTIFACTS, Control, Diagnosis, Exports, Model
from ropefit.artifacts.atomic import write_bytes
from ropefit.errors import StageFailed, WrongUsage
from ropefit.runs.code import PACKAGE, code_sha256
from ropefit.runs.lock import working_on
from ropefit.runs.protocol import Progress
from ropefit.runs.run_directory import REPORT, existing_run


def write_report(directory: Path, say: Callable[[str], None], force: bool = False) -> Path:
    """Write report.html of a run and return its path; a page made of the same artifacts by the same
    code stays, unless by force.

    Raises StageFailed when there are no observations or an artifact is stale, BadInput when one is
    damaged. A kill at any instant leaves the old page or the new one.
    """
    run = read_run(directory)
    parts = ((Model, run.model), (Control, run.control), (Diagnosis, run.diagnosis))
    missing = [kind.file_name for kind, part in parts if part is None]
    if missing:
        say(f"the report has no part on {' and '.join(missing)}: not in this run")
    if run.exports is None and (directory / Exports.file_name).exists():
        say(f"{Exports.file_name} was made from an earlier fit and is not shown; export again")
    path, made_of = directory / REPORT, f"<!-- {_source_of(directory)} -->\n"
    if not force and path.exists() and path.read_bytes().endswith(made_of.encode()):
        return path
    from ropefit.reporting.report import render_report

    text = render_report(run) + made_of
    with working_on(directory):
        _write(path, text)
    return path


def _source_of(directory: Path) -> str:
    """Return a hash of all that a run's page is made of: artifacts, code, style and script."""
    digest = hashlib.sha256(f"{__version__} {code_sha256('ropefit.reporting.report')}".encode())
    page = sorted((PACKAGE / "reporting").glob("*.[chj]*"))
    for path in (*page, *(directory / kind.file_name for kind in ARTIFACTS)):
        if path.is_file():
            digest.update(f"{path.name} {path.stat().st_size} ".encode() + path.read_bytes())
    return digest.hexdigest()


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
