"""The command line on each case, as a user calls it; results of finished cases are kept."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

TIMEOUT = 900.0  # s, one command


class Failed(RuntimeError):
    """A command did not print its object."""


def command(*arguments: str | Path, timeout: float = TIMEOUT) -> dict[str, Any]:
    """The JSON object of one ropefit command."""
    line = [sys.executable, "-m", "ropefit", *map(str, arguments), "--json"]
    try:
        run = subprocess.run(line, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise Failed(f"{arguments[0]}: longer than {timeout:.0f} s") from None
    if run.returncode not in (0, 4):
        last = run.stderr.strip().splitlines()[-1:] or ["no message"]
        raise Failed(f"{arguments[0]}: exit {run.returncode}: {last[0]}")
    try:
        return json.loads(run.stdout)
    except json.JSONDecodeError:
        raise Failed(f"{arguments[0]}: no JSON object on standard output") from None


def diagnose(
    recording: Path, run: Path, preprocess: tuple[str, ...] = (), nominal: Path | None = None,
    identify: tuple[str, ...] = (),
) -> dict[str, Any]:  # fmt: skip
    """Answer, times [s] and error of the three stages on one recording; with options for two."""
    return stages(
        ("preprocess", recording, "--run", run, *preprocess),
        ("identify", "--run", run, *identify),
        ("diagnose", "--run", run, *(("--nominal", nominal) if nominal else ())),
    )


def identified(recording: Path, run: Path) -> dict[str, Any]:
    """The same of a recording that is to be another's nominal model."""
    return stages(("preprocess", recording, "--run", run), ("identify", "--run", run))


def stages(*steps: tuple[str | Path, ...]) -> dict[str, Any]:
    """The last answer of some commands, times [s] and the error of the first that failed."""
    seconds: dict[str, float] = {}
    out: dict[str, Any] = {"seconds": seconds, "answer": None, "error": None}
    for step in steps:
        start = time.perf_counter()
        try:
            out["answer"] = command(*step)
        except Failed as error:
            out |= {"answer": None, "error": str(error)}
        seconds[str(step[0])] = time.perf_counter() - start
        if out["error"]:
            break
    return out


def kept(path: Path, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """The result in a file, or else of `work()`, which is then kept there; whole or not at all.

    A result without an answer is not final: the work is done again.
    """
    if path.exists():
        result = json.loads(path.read_text())
        if result["answer"] is not None:
            return result
    result = work()
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(result, indent=1) + "\n")
    part.replace(path)
    return result
