"""All artifacts of a run at once, for whoever shows them."""

from __future__ import annotations

from pathlib import Path

from ropefit.artifacts import Control, Diagnosis, Model, Observations
from ropefit.reporting.contents import RunContents
from ropefit.runs.loading import load, load_if_there
from ropefit.stages.export_check import current_exports


def read_run(directory: Path) -> RunContents:
    """What a run directory holds; None where a stage has not run.

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
