"""The command line, run as a user runs it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any


def ropefit(*arguments: str | Path) -> dict[str, Any]:
    """The JSON object of one command, run in a process of its own."""
    command = [sys.executable, "-m", "ropefit", *map(str, arguments), "--quiet", "--json"]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode != 0:
        raise SystemExit(run.stderr.strip() or f"{command} failed")
    return json.loads(run.stdout)
