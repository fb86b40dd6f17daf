"""A run is a directory of artifacts. Which command writes which file, and what counts as a run."""

from __future__ import annotations

import os
from pathlib import Path

from ropefit.artifacts import Control, Diagnosis, Exports, Model, Observations
from ropefit.errors import StageFailed, WrongUsage
from ropefit.runs.checkpoint import checkpoint_name

PRODUCERS = {
    Observations.file_name: "ropefit preprocess RECORDING",
    Model.file_name: "ropefit identify",
    Diagnosis.file_name: "ropefit diagnose",
    Control.file_name: "ropefit control",
    Exports.file_name: "ropefit export --to TARGET --out FILE",
}
REPORT = "report.html"
CHECKPOINTS = {
    checkpoint_name(stage) for stage in ("preprocess", "identify", "diagnose", "control")
}
KNOWN = {*PRODUCERS, *CHECKPOINTS, REPORT, "figures", "view.rrd"}


def is_run(directory: Path) -> bool:
    """Return whether a directory holds any artifact of ours."""
    return any((directory / name).exists() for name in PRODUCERS)


def existing_run(directory: Path) -> Path:
    """Return the run directory, or one line on why it is none."""
    if not directory.exists():
        raise StageFailed(
            f"{directory}: no such run; run `ropefit preprocess RECORDING --run {directory}`"
        )
    if not directory.is_dir():
        raise WrongUsage(f"{directory}: is a file, not a run directory")
    if (directory / "recording.toml").exists() and not is_run(directory):
        raise StageFailed(
            f"{directory}: not a ropefit run but a recording; run `ropefit preprocess {directory} "
            "--run my_run`, then give --run my_run"
        )
    if not is_run(directory):
        raise StageFailed(
            f"{directory}: not a ropefit run (no artifacts in it); give another --run, or start "
            "one with `ropefit preprocess RECORDING --run my_run`"
        )
    return directory


def new_run(directory: Path) -> Path:
    """Return a directory to start a run in: new (it is made with its first artifact), empty, or a
    run."""
    if directory.exists() and not directory.is_dir():
        raise WrongUsage(f"{directory}: is a file, not a directory; give another --run")
    if directory.is_dir() and any(directory.iterdir()) and not is_run(directory):
        strangers = [
            p.name for p in directory.iterdir() if p.name not in KNOWN and p.name[0] != "."
        ]
        if strangers:
            raise WrongUsage(
                f"{directory}: holds other files ({strangers[0]}, ...) and is not a ropefit run; "
                "give an empty or new directory as --run"
            )
    whole = directory.absolute()
    above = next(path for path in (whole, *whole.parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise StageFailed(f"{directory}: cannot be written in {above}; give another --run")
    return directory
