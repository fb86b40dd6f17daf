"""The command line, run as a user runs it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

NOT_CONVERGED = 4  # exit code: the answer is printed all the same


class CommandFailed(RuntimeError):
    """A command did not print its object. `code`: the exit code; `line`: its last words."""

    def __init__(self, stage: str, code: int, line: str):
        super().__init__(f"{stage}: exit {code}: {line}")
        self.code, self.line = code, line


def ropefit(
    *arguments: str | Path, timeout: float | None = None, unconverged: bool = False
) -> dict[str, Any]:
    """Return the JSON object of one command, run in a process of its own.

    timeout [s]; unconverged: accept the answer of a command that did not converge. Raises
    CommandFailed.
    """
    stage = str(arguments[0])
    command = [sys.executable, "-m", "ropefit", *map(str, arguments), "--quiet", "--json"]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        raise CommandFailed(stage, -1, f"longer than {timeout:.0f} s") from None
    if run.returncode not in ((0, NOT_CONVERGED) if unconverged else (0,)):
        line = (run.stderr.strip().splitlines() or ["no message"])[-1]
        raise CommandFailed(stage, run.returncode, line)
    try:
        return json.loads(run.stdout)
    except json.JSONDecodeError:
        raise CommandFailed(stage, run.returncode, "no JSON object on standard output") from None


def processor_time() -> float:
    """Return the processor time [s] of all commands that have ended."""
    used = os.times()
    return used.children_user + used.children_system
