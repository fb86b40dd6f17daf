"""report: one HTML page from the artifacts of a run."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from ropefit.artifacts import Control, Diagnosis, Model, Observations
from ropefit.errors import StageFailed
from ropefit.stages.lock import working_on
from ropefit.stages.run_directory import REPORT
from ropefit.stages.stage import A, load


def write_report(directory: Path, say: Callable[[str], None]) -> Path:
    """Write report.html of a run and return its path.

    Raises StageFailed when there are no observations or an artifact is stale, BadInput when one is
    damaged. A kill at any instant leaves the old page or the new one.
    """
    from ropefit.reporting.report import RunContents, render_report

    observations, _ = load(directory, Observations)
    run = RunContents(
        observations,
        _if_there(directory, Model),
        _if_there(directory, Control),
        _if_there(directory, Diagnosis),
    )
    parts = ((Model, run.model), (Control, run.control), (Diagnosis, run.diagnosis))
    missing = [kind.file_name for kind, part in parts if part is None]
    if missing:
        say(f"the report has no part on {' and '.join(missing)}: not in this run")
    path = directory / REPORT
    text = render_report(run)
    with working_on(directory):
        _write(path, text)
    return path


def _if_there(directory: Path, kind: type[A]) -> A | None:
    if not (directory / kind.file_name).exists():
        return None
    return load(directory, kind)[0]


def _write(path: Path, text: str) -> None:
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=".tmp", dir=path.parent
        )
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise StageFailed(
            f"cannot write {path}: {error.strerror}; free space or give another --run"
        )
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
