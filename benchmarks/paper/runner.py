"""Runs an experiment as a user would: the command line, one process a stage."""

from __future__ import annotations

import csv
import json
import os
import shlex
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import CommandFailed, ropefit
from benchmarks.paper.pipeline import Derived, Experiment, Rendered, TargetTable
from benchmarks.paper.recordings import derive, load_truth, make
from ropefit.artifacts import Model, Observations


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
        """Return the run directory of one of a run's several control stages."""
        return self.folder / "control" / f"{run}-{name}"

    def said(self, run: str) -> Path:
        """Return what the commands of a run said."""
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
        said = _stages(experiment, name, place)
        place.said(name).parent.mkdir(parents=True, exist_ok=True)
        place.said(name).write_text(json.dumps(said, indent=1))


def recall(experiment: Experiment, place: Place) -> dict[str, Any]:
    """Return what the commands of finished runs said: {run: {stage: JSON}}."""
    done = [name for name in experiment.runs if place.said(name).exists()]
    return {name: json.loads(place.said(name).read_text()) for name in done}


def _shared(experiment: Experiment, name: str, place: Place) -> dict[str, Any] | None:
    """Give a run the observations of an earlier one that are made likewise, and tell what was said
    there; None where it has to make its own."""
    run, before = experiment.runs[name], recall(experiment, place)
    for other, same in experiment.runs.items():
        if other == name:
            return None
        alike = (same.recording, same.preprocess) == (run.recording, run.preprocess)
        if alike and other in before:
            place.run(name).mkdir(parents=True, exist_ok=True)
            shutil.copy(place.run(other) / Observations.file_name, place.run(name))
            return before[other]["preprocess"]
    return None


def _stages(experiment: Experiment, name: str, place: Place) -> dict[str, Any]:
    run, before, folder = experiment.runs[name], recall(experiment, place), place.run(name)
    shared = _shared(experiment, name, place)
    out: dict[str, Any] = {"preprocess": shared} if shared else {}
    own = f"{place.recording(run.recording)} {run.preprocess}"
    stages = [] if shared else [("preprocess", own)]
    stages += [("identify", run.identify)] if run.identify is not None else []
    stages += [("diagnose", run.diagnose)] if run.diagnose is not None else []
    for stage, options in stages:
        options = _filled(options, place, before)
        out[stage] = _ropefit(stage, options, folder, run.fails == stage)
        if "failed" in out[stage]:
            return out

    def controlled(item: tuple[str, str]) -> tuple[str, dict[str, Any]]:
        key, options = item
        mine = place.control(name, key)
        mine.mkdir(parents=True, exist_ok=True)
        for artifact in (Observations, Model):
            shutil.copy(folder / artifact.file_name, mine)
        return f"control {key}", _ropefit("control", _filled(options, place, before), mine, False)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return out | dict(pool.map(controlled, run.control.items()))


def _filled(options: str, place: Place, before: dict[str, Any]) -> str:
    """Return options with {runs}, {targets}, {value[RUN][NAME]} and {weights[RUN]} put in.

    {weights}: every weight of an earlier run but gravity's, as a start.
    """
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


def _ropefit(stage: str, options: str, run: Path, may_fail: bool) -> dict[str, Any]:
    """Run one command: return its JSON, or {"failed": its line, "code": ...} where it may fail."""
    begin = time.monotonic()
    try:
        return ropefit(stage, *shlex.split(options), "--run", run)
    except CommandFailed as failed:
        if not may_fail:
            raise SystemExit(f"{run.name}: {failed}")
        return {"failed": failed.line, "code": failed.code}
    finally:
        print(f"{run.name}: {stage} {options} ({time.monotonic() - begin:.0f} s)", file=sys.stderr)


def _write_targets(place: Place, name: str, table: TargetTable) -> None:
    """Write target points of some frames of a recording, as markers on the rope would show them."""
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
