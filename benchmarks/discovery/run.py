"""Run the command line on each case, and keep the results of finished cases."""

from __future__ import annotations

import argparse
import json
import os
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.command import CommandFailed, processor_time, ropefit

TIMEOUT = 900.0  # s, one command


def read_json(path: Path) -> dict[str, Any]:
    """Return the object in a JSON file."""
    return json.loads(path.read_text())


def shard(text: str) -> tuple[int, int]:
    """Return I and N of an option I/N: every N-th case from the I-th."""
    match = re.fullmatch(r"([1-9]\d*)/([1-9]\d*)", text)
    if match is None or int(match[1]) > int(match[2]):
        raise argparse.ArgumentTypeError("expected I/N with 1 <= I <= N")
    return int(match[1]), int(match[2])


def diagnose(
    recording: Path, run: Path, preprocess: tuple[str, ...] = (), nominal: Path | None = None,
    identify: tuple[str, ...] = (),
) -> dict[str, Any]:  # fmt: skip
    """Run the three stages on a recording: return the answer, times [s] and the error."""
    return stages(
        ("preprocess", recording, "--run", run, *preprocess),
        ("identify", "--run", run, *identify),
        ("diagnose", "--run", run, *(("--nominal", nominal) if nominal else ())),
    )


def identified(recording: Path, run: Path) -> dict[str, Any]:
    """Run two stages on a recording that is to be another's nominal model."""
    return stages(("preprocess", recording, "--run", run), ("identify", "--run", run))


def stages(*steps: tuple[str | Path, ...]) -> dict[str, Any]:
    """Return the last answer of some commands, their times and the processor time of all [s], and
    the error of the first that failed."""
    seconds: dict[str, float] = {}
    before = processor_time()
    out: dict[str, Any] = {"seconds": seconds, "answer": None, "error": None}
    for step in steps:
        start = time.perf_counter()
        try:
            out["answer"] = ropefit(*step, timeout=TIMEOUT, unconverged=True)
        except CommandFailed as error:
            out |= {"answer": None, "error": str(error)}
        seconds[str(step[0])] = time.perf_counter() - start
        if out["error"]:
            break
    return out | {"processor": processor_time() - before}


def kept(path: Path, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return the result in a file, or else that of `work()`, then written there atomically.

    A result without an answer is not final: the work is done again.
    """
    if path.exists():
        result = read_json(path)
        if result["answer"] is not None:
            return result
    result = work()
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(result, indent=1) + "\n")
    part.replace(path)
    return result
