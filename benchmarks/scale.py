"""What a batch costs: seconds and bytes of a task, one worker against two, memory over many tasks.

python -m benchmarks.scale [--recordings 1000] [--until preprocess] [--write docs/scale.md]

Recordings are the same tiny one (markers, 4 frames) under many names, so that what is measured is
what a batch adds to its stages. Weak scaling: n recordings by one worker against 2 n by two, once
all is compiled and imported; 1 is ideal.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import parser, publish
from ropefit.batch import run_batch
from ropefit.console import Session
from tests.factories import marker_recording

SETTINGS = {
    "preprocess": {"nodes": 6, "project": "auto"},
    "identify": {"solver": "thomas", "steps": 4, "iterations": 3, "evaluations": 3},
    "control": {"evaluations": 3},
}
MILLION = 1_000_000


def batch(folder: Path, runs: Path, until: str, workers: int) -> tuple[float, list[dict[str, Any]]]:
    """Seconds and what is known of each recording, in the order in which they were begun."""
    started = time.monotonic()
    quiet = Session(quiet=True)
    data = run_batch(quiet, [folder], runs, SETTINGS, until, workers=workers)
    return time.monotonic() - started, data["recordings"]


def recordings(folder: Path, count: int) -> Path:
    """`count` copies of one recording."""
    for number in range(count):
        marker_recording(folder / f"r{number:06d}", frames=4)
    return folder


def growth(found: list[dict[str, Any]]) -> float:
    """Bytes by which a worker's most memory grows over the last three quarters of its tasks."""
    peaks = np.array([r["peak_memory_bytes"] for r in found], dtype=float)
    part = max(len(peaks) // 4, 1)
    return float(np.median(peaks[-part:]) - np.median(peaks[part : 2 * part]))


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
    """One recording through all stages; then weak scaling and memory over many."""
    batch(recordings(scratch / "warm", 2), scratch / "warm runs", "report", 2)  # compile, import
    _, whole = batch(recordings(scratch / "whole", 1), scratch / "whole runs", "report", 1)
    few = max(count // 2, 1)
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
        "peak": found[-1]["peak_memory_bytes"],
        "growth": growth(found),
    }


def table(data: dict[str, Any]) -> str:
    """The measured costs and what a million such recordings need."""
    lines = [
        "Written by `python -m benchmarks.scale`; a tiny recording of markers, 4 frames.",
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
        f"{data['two_workers_s']:.1f} s for all: weak scaling {data['weak_scaling']:.2f}. "
        f"A worker held {data['peak'] / 1e6:.0f} MB at "
        f"most, and {data['growth'] / 1e6:+.1f} MB more at the end than after the first quarter.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
