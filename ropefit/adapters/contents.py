"""All artifacts of a run at once, for whoever shows them."""

from __future__ import annotations

from pathlib import Path

from ropefit.artifacts import Control, Diagnosis, Exports, Model, Observations
from ropefit.errors import StageFailed
from ropefit.reporting.contents import RunContents
from ropefit.runs.loading import load, load_if_there


def read_run(directory: Path) -> RunContents:
    """Return what a run directory holds; None where a stage has not run.

    Raises StageFailed when there are no observations or an artifact is stale, BadInput when one is
    damaged.
    """
    return RunContents(
        load(directory, Observations)[0],
        load_if_there(directory, Model),
        load_if_there(directory, Control),
        load_if_there(directory, Diagnosis),
        current_exports(directory),
    )


def current_exports(run: Path) -> Exports | None:
    """Return exports.h5 of the rope as it is now; None where there is none, or an earlier
    rope's."""
    path = run / Exports.file_name
    try:
        made = load(run, Exports)[0] if path.exists() else None
    except StageFailed:  # the rope was identified again since
        return None
    diagnosed = (run / Diagnosis.file_name).exists()
    return made if made and (Diagnosis.file_name in made.provenance.inputs) == diagnosed else None
