"""Runs an experiment as a user would: the command line, one process a stage."""

from __future__ import annotations

import csv
import json
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.pipeline import Derived, Experiment, Rendered, RunTable, TargetTable
from benchmarks.paper.recordings import derive, load_truth, make
from ropefit.artifacts import Control, Observations


@dataclass(frozen=True)
class Place:
    """Where an experiment keeps what it makes; nothing of it is in the repository."""

    folder: Path

    def recording(self, name: str) -> Path:
        return self.folder / "recordings" / name

    def run(self, name: str) -> Path:
        return self.folder / "runs" / name

    def targets(self, name: str) -> Path:
        return self.folder / "targets" / f"{name}.csv"

    def control(self, run: str, name: str) -> Path:
        """The control.h5 of one of a run's several."""
        return self.folder / "control" / f"{run}-{name}.h5"

    def said(self, run: str) -> Path:
        """What the commands of a run said."""
        return self.folder / "said" / f"{run}.json"


def perform(experiment: Experiment, place: Place, only: set[str] | None = None) -> None:
    """Make the recordings and run the commands; what they say is kept. Raises SystemExit where one
    fails that should not. only: these runs, where the others are done."""
    for name, run in experiment.runs.items():
        if only and name not in only:
            continue
        source = experiment.recordings[run.recording]
        folder = place.recording(run.recording)
        if isinstance(source, Derived):
            origin = experiment.runs[source.run].recording
            derive(folder, source, place.run(source.run), place.recording(origin))
        else:
            make(folder, source)
        for target, table in experiment.targets.items():
            recording = experiment.recordings[table.recording]
            assert isinstance(recording, Rendered)
            make(place.recording(table.recording), recording)
            _write_targets(place, target, table)
        _share(experiment, name, place)
        said = _stages(name, run, place, recall(experiment, place))
        place.said(name).parent.mkdir(parents=True, exist_ok=True)
        place.said(name).write_text(json.dumps(said, indent=1))


def recall(experiment: Experiment, place: Place) -> dict[str, Any]:
    """{run: {stage: JSON}} of what commands said, of the runs that are done."""
    done = [name for name in experiment.runs if place.said(name).exists()]
    return {name: json.loads(place.said(name).read_text()) for name in done}


def _share(experiment: Experiment, name: str, place: Place) -> None:
    """Give a run the observations of an earlier one that were made likewise; preprocess then finds
    them up to date, or makes its own."""
    run, mine = experiment.runs[name], place.run(name) / Observations.file_name
    for other, same in experiment.runs.items():
        if other == name or mine.exists():
            return
        made = place.run(other) / Observations.file_name
        alike = (same.recording, same.preprocess) == (run.recording, run.preprocess)
        if alike and made.exists():
            mine.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(made, mine)


def _stages(name: str, run: RunTable, place: Place, before: dict[str, Any]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    folder = place.run(name)
    stages = [("preprocess", f"{place.recording(run.recording)} {run.preprocess}")]
    stages += [("identify", run.identify)] if run.identify is not None else []
    stages += [("diagnose", run.diagnose)] if run.diagnose is not None else []
    for stage, options in stages:
        options = _filled(options, place, before)
        out[stage] = _ropefit(stage, options, name, place, run.fails == stage)
        if "failed" in out[stage]:
            return out
    for key, options in run.control.items():
        options = _filled(options, place, before)
        out[f"control {key}"] = _ropefit("control", options, name, place, False)
        kept = place.control(name, key)
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(folder / Control.file_name, kept)
    return out


def _filled(options: str, place: Place, before: dict[str, Any]) -> str:
    """Options with {runs}, {targets}, {value[RUN][NAME]} and {weights[RUN]}, every weight of an
    earlier run but gravity's as a start, put in."""
    value = {
        run: {name: p["value"] for name, p in one["parameters"].items()}
        for run, said in before.items()
        if "groups" in said.get("identify", {})
        for one in [next(iter(said["identify"]["groups"].values()))]
    }
    weights = {
        run: " ".join(
            f"--start {name}={v!r}" for name, v in known.items() if not name.startswith("eta_x_G")
        )
        for run, known in value.items()
    }
    runs, targets = place.folder / "runs", place.folder / "targets"
    return options.format(runs=runs, targets=targets, value=value, weights=weights)


def _ropefit(stage: str, options: str, run: str, place: Place, may_fail: bool) -> dict[str, Any]:
    """The JSON of one command; {"failed": its line, "code": ...} of one whose failure counts."""
    command = [sys.executable, "-m", "ropefit", stage, *shlex.split(options)]
    command += ["--run", str(place.run(run))]
    begin = time.monotonic()
    done = subprocess.run([*command, "--quiet", "--json"], capture_output=True, text=True)
    print(f"{run}: {stage} {options} ({time.monotonic() - begin:.0f} s)", file=sys.stderr)
    if done.returncode == 0:
        return json.loads(done.stdout)
    line = done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "no message"
    if not may_fail:
        raise SystemExit(f"{run}: {stage}: {line}")
    return {"failed": line, "code": done.returncode}


def _write_targets(place: Place, name: str, table: TargetTable) -> None:
    """Target points of some frames of a recording, as markers on the rope would show them."""
    truth = load_truth(place.recording(table.recording))
    rng = np.random.default_rng(table.frames)
    path = place.targets(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["x", "y", "z", "arc_length", "target"])
        for t in table.frames:
            for s in table.at:
                point = [np.interp(s, truth["arc"], truth["nodes"][t, :, k]) for k in range(3)]
                point += table.noise * rng.standard_normal(3)
                writer.writerow([*(f"{v:.6f}" for v in point), s, t])
