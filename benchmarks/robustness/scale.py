"""What a batch costs: seconds and bytes of a task, one worker against two, memory over many tasks,
and what the dispatching process needs for each.

    python -m benchmarks.robustness.scale [--recordings 1000] [--until preprocess]
                                          [--write docs/scale.md]

Recordings are the same tiny one (markers, 4 frames) under many names, so that what is measured is
what a batch adds to its stages. Weak scaling: n recordings by one worker against 2 n by two, once
all is compiled and imported; 1 is ideal.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from ropefit.batch import run_batch
from ropefit.batch.index import summary, write_index
from ropefit.batch.names import find_recordings
from ropefit.batch.records import FOLDER, read_record
from ropefit.batch.run import _tasks
from ropefit.runs.threads import processors
from tests.factories import marker_recording

SETTINGS = {
    "preprocess": {"nodes": 6, "project": "auto"},
    "identify": {"solver": "thomas", "steps": 4, "iterations": 3, "evaluations": 3},
    "control": {"evaluations": 3},
}
MILLION = 1_000_000
WORKERS = 1000
# What one process, page or folder may grow to: how much, and why.
LIMITS = {
    "index.html": (50e6, "B", "a page that a browser opens at once"),
    "summary.csv": (1e9, "B", "a table that is read as one"),
    "memory of the dispatching process": (8e9, "B", "half of a machine of 16 GB"),
    "time to list and report, without work": (3600.0, "s", "an hour before and after"),
    "files": (100e6, "", "inodes of a file system of some TB"),
}


def batch(folder: Path, runs: Path, until: str, workers: int) -> tuple[float, list[dict[str, Any]]]:
    """Run a batch: return seconds and the record of each recording, in order of their start."""
    started = time.monotonic()
    done = run_batch([folder], runs, SETTINGS, until, workers=workers)
    data = summary(done)
    return time.monotonic() - started, data["recordings"]


def recordings(folder: Path, count: int) -> Path:
    """Make `count` copies of one recording."""
    for number in range(count):
        marker_recording(folder / f"r{number:06d}", frames=4)
    return folder


def growth(found: list[dict[str, Any]]) -> float:
    """Return the growth [B] of a worker's peak memory over the last three quarters of its tasks."""
    peaks = np.array([r["peak_memory_bytes"] for r in found], dtype=float)
    part = max(len(peaks) // 4, 1)
    return float(np.median(peaks[-part:]) - np.median(peaks[part : 2 * part]))


def per_recording(folder: Path, runs: Path) -> dict[str, float]:
    """Return what the dispatching process needs for each recording, and leaves behind."""
    tracemalloc.start()
    started = time.monotonic()
    tasks = _tasks(find_recordings([folder]), runs, SETTINGS, "report")
    records = [record for task in tasks if (record := read_record(runs, task.name))]
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    write_index(runs, records)
    seconds = time.monotonic() - started
    pages = [(runs / name).stat().st_size for name in ("index.html", "summary.csv")]
    write_index(runs, [])  # what they are without any
    empty = [(runs / name).stat().st_size for name in ("index.html", "summary.csv")]
    run = runs / records[0].name
    files = sum(path.is_file() for path in run.rglob("*")) + 1  # and its record
    found = {
        "index.html": pages[0] - empty[0],
        "summary.csv": pages[1] - empty[1],
        "memory of the dispatching process": held,
        "time to list and report, without work": seconds,
        "record in " + FOLDER: sum(p.stat().st_size for p in (runs / FOLDER).rglob("*.json")),
    }
    return {name: value / len(records) for name, value in found.items()} | {"files": float(files)}


def main() -> None:
    """Print the table; write it where asked."""
    p = parser(__doc__)
    p.add_argument("--recordings", type=int, default=1000)
    p.add_argument("--until", default="preprocess", help="stages of the many recordings")
    options = p.parse_args()
    scratch = Path(tempfile.mkdtemp(prefix="ropefit-scale-"))
    try:
        data = measure(options.recordings, options.until, scratch)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    publish(options, "scale", table(data), data)


def measure(count: int, until: str, scratch: Path) -> dict[str, Any]:
    """Run one recording through all stages; measure weak scaling and memory over many."""
    batch(recordings(scratch / "warm", 2), scratch / "warm runs", "report", 2)  # compile, import
    _, whole = batch(recordings(scratch / "whole", 1), scratch / "whole runs", "report", 1)
    few = max(count // 2, 1)
    load = os.getloadavg()[0]
    one, _ = batch(recordings(scratch / "one", few), scratch / "one runs", until, 1)
    two, found = batch(recordings(scratch / "two", 2 * few), scratch / "two runs", until, 2)
    found.sort(key=lambda r: r["name"])
    return {
        "seconds": whole[0]["seconds"],
        "bytes": whole[0]["bytes"],
        "recordings": 2 * few,
        "until": until,
        "one_worker_s": one,
        "two_workers_s": two,
        "weak_scaling": one / two,
        "processors": processors(),
        "load": load,
        "peak": found[-1]["peak_memory_bytes"],
        "growth": growth(found),
        "per_recording": per_recording(scratch / "two", scratch / "two runs")
        | {"files": per_recording(scratch / "whole", scratch / "whole runs")["files"]},
    }


def table(data: dict[str, Any]) -> str:
    """Return the measured costs and what a million such recordings need."""
    lines = [
        "Written by `python -m benchmarks.robustness.scale`; a small recording: markers, 4 frames.",
        "",
        "| stage | time [s] | a million, on 1000 workers [h] |",
        "|---|---|---|",
    ]
    for stage, seconds in data["seconds"].items():
        lines.append(f"| {stage} | {seconds:.2f} | {MILLION * seconds / 1000 / 3600:.2f} |")
    lines += ["", "| file | size [kB] | of a million [GB] |", "|---|---|---|"]
    for name, size in data["bytes"].items():
        lines.append(f"| {name} | {size / 1e3:.1f} | {size * MILLION / 1e9:.0f} |")
    lines += [
        "",
        f"{data['recordings']} recordings up to {data['until']}: one worker took "
        f"{data['one_worker_s']:.1f} s for half of them, two "
        f"{data['two_workers_s']:.1f} s for all: weak scaling {data['weak_scaling']:.2f}, on "
        f"{data['processors']} processors with {data['load']:.1f} others at work on average. "
        f"A worker held {data['peak'] / 1e6:.0f} MB at "
        f"most, and {data['growth'] / 1e6:+.1f} MB more at the end than after the first quarter.",
        "",
        "| what grows with the recordings | of one | of a million | limit | reached at |",
        "|---|---|---|---|---|",
    ]
    for name, value in data["per_recording"].items():
        limit, unit, why = LIMITS.get(name, (0.0, "B", ""))
        row = f"| {name} | {_told(value, unit)} | {_told(value * MILLION, unit)} |"
        reached = f" {_told(limit, unit)}: {why} | {_round(limit / value)} |" if limit else " | |"
        lines.append(row + reached)
    task, size = sum(data["seconds"].values()), sum(data["bytes"].values())
    grows = data["per_recording"].items()
    first = min((LIMITS[name][0] / value, name) for name, value in grows if name in LIMITS)
    heaviest = max(data["bytes"], key=data["bytes"].get)
    lines += [
        "",
        f"It breaks first in {first[1]}, at some {_round(first[0])} recordings; the rest of the "
        f"batch does not need it. {WORKERS} workers on tasks of {task:.1f} s ask for "
        f"{WORKERS / task:.0f} tasks a second and write "
        f"{WORKERS / task * len(data['bytes']):.0f} files a second, "
        f"{WORKERS / task * size / 1e6:.0f} MB a second, of which "
        f"{data['bytes'][heaviest] / size:.0%} is {heaviest}.",
    ]
    return "\n".join(lines) + "\n"


def _told(value: float, unit: str) -> str:
    """Return a value with three digits and a prefix."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m")):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}{unit}".rstrip()
    return f"{value:.3g} {unit}".rstrip()


def _round(count: float) -> str:
    return f"{float(f'{count:.1g}'):,.0f}"


if __name__ == "__main__":
    main()
