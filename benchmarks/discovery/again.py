"""Recordings diagnosed again from their identified runs: the same answers, and in which time?

    python -m benchmarks.discovery.again DIR [--only REGEX] [--shard I/N] [--out DIR] [--json FILE]

DIR: of a seed, as `python -m benchmarks.discovery` leaves it, with runs/ and results/. Every run is
copied, and diagnosed by this state of the program. OMP_NUM_THREADS=1 keeps each to one core.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import CommandFailed, processor_time, ropefit
from benchmarks.discovery.run import read_json, shard
from benchmarks.document import parser, publish

PARAMETERS = ("value", "ci95")


def main() -> None:
    """Diagnose, compare, print."""
    arguments = parser(__doc__)
    arguments.add_argument("seed", type=Path, help="folder of a seed")
    arguments.add_argument("--only", default=".*", help="regular expression of recordings' names")
    arguments.add_argument("--shard", type=shard, default=(1, 1), help="I/N: every N-th of them")
    arguments.add_argument("--out", type=Path, default=Path("again"), help="folder of the copies")
    options = arguments.parse_args()
    first, shards = options.shard
    found = sorted(path.parent.name for path in options.seed.glob("runs/*/model.h5"))
    names = [n for n in found if re.fullmatch(options.only, n) and was_diagnosed(options.seed, n)]
    names = names[first - 1 :: shards]
    rows = []
    for name in names:
        rows.append(again(options.seed, name, options.out / name))
        print(markdown_row(rows[-1]), flush=True)
    publish(options, "again", markdown(rows), {"recordings": rows})


def again(seed: Path, name: str, run: Path) -> dict[str, Any]:
    """Return what a recording is called now and before, by how much its values differ (None: they
    are not of the same effects), and the processor time [s] of its diagnosis."""
    shutil.rmtree(run, ignore_errors=True)
    shutil.copytree(
        seed / "runs" / name, run, ignore=lambda _, files: [f for f in files if "diagnosis" in f]
    )
    began = processor_time()
    try:
        now, error = ropefit("diagnose", "--run", run, unconverged=True), None
    except CommandFailed as failed:
        now, error = None, str(failed)
    seconds = processor_time() - began
    before = read_json(seed / "results" / f"{name}.json")["answer"]
    return {
        "name": name, "before": called(before), "now": called(now), "error": error,
        "differs": difference(before, now), "processor": seconds,
    }  # fmt: skip


def was_diagnosed(seed: Path, name: str) -> bool:
    """Return whether a recording of a seed was diagnosed, not only identified as the nominal run of
    another."""
    answer = read_json(seed / "results" / f"{name}.json")["answer"]
    return answer is None or "effects" in answer


def called(answer: dict[str, Any] | None) -> str:
    """Return the verdict of an answer, its effects, and their ties, as text."""
    if answer is None:
        return "no answer"
    effects = [
        " = ".join([one["name"], *sorted(one["equivalent_to"])]) for one in answer["effects"]
    ]
    return ", ".join(effects) or answer["verdict"]


def difference(before: dict[str, Any] | None, now: dict[str, Any] | None) -> float | None:
    """Return the largest relative difference of all values and ends of intervals of two answers;
    None if they do not name the same."""
    if before is None or now is None or called(before) != called(now):
        return None
    if before["verdict"] != now["verdict"]:
        return None
    a, b = _numbers(before), _numbers(now)
    if a.shape != b.shape:
        return None
    size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.finfo(float).tiny)
    unlike = ~((a == b) | (np.isnan(a) & np.isnan(b)))
    return float(np.max((np.abs(a - b) / size)[unlike], initial=0.0))


def _numbers(answer: dict[str, Any]) -> np.ndarray:
    every = [value for one in answer["effects"] for value in one["parameters"].values()]
    return np.array([np.hstack([value[key] for key in PARAMETERS]) for value in every], dtype=float)


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table, slowest first."""
    slowest = sorted(rows, key=lambda row: -row["processor"])
    same = sum(row["differs"] == 0 for row in rows)
    named = sum(row["differs"] is not None for row in rows)
    longest = slowest[0]["processor"] if slowest else 0.0
    return "\n".join([
        "Recordings diagnosed again by `python -m benchmarks.discovery.again`.",
        "",
        "| recording | called | before | values differ by | processor time [s] |",
        "|---|---|---|---|---|",
        *(markdown_row(row) for row in slowest),
        "",
        f"{len(rows)} recordings; called the same: {named}; with the same values to the last "
        f"digit: {same}; longest processor time: {longest:.0f} s.",
    ])  # fmt: skip


def markdown_row(row: dict[str, Any]) -> str:
    """Return one line of the table."""
    differs = "" if row["differs"] is None else f"{row['differs']:.1g}"
    before = "same" if row["differs"] is not None else row["before"]
    now = row["error"] or row["now"]
    return f"| {row['name']} | {now} | {before} | {differs} | {row['processor']:.0f} |"


if __name__ == "__main__":
    main()
