"""Shared by all tests: one thread, shape checks on, where the recordings are, the command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

# Shapes in annotations are checked while tests run, and only then.
install_import_hook(["ropefit.rod", "ropefit.losses"], "beartype.beartype")
os.environ["OMP_NUM_THREADS"] = "1"

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
REAL = ROOT.parent / "shared" / "real"


@pytest.fixture
def real() -> Path:
    """Folder of the real recordings; the test is skipped where they are not kept."""
    if not REAL.is_dir():
        pytest.skip(f"real recordings are not at {REAL}")
    return REAL


class Command:
    """Run `ropefit` in a process of its own."""

    def __init__(self, directory: Path):
        self.directory = directory

    def __call__(self, *arguments: str | Path, code: int = 0) -> subprocess.CompletedProcess[str]:
        result = subprocess.run(
            [sys.executable, "-m", "ropefit", *map(str, arguments)],
            cwd=self.directory,
            capture_output=True,
            text=True,
            timeout=600,
            env={**os.environ, "COLUMNS": "80"},
        )
        assert result.returncode == code, result.stderr
        assert "Traceback" not in result.stderr
        return result

    def json(self, *arguments: str | Path) -> dict:
        """The object that --json prints; nothing else may be on standard output."""
        return json.loads(self(*arguments, "--json").stdout)


@pytest.fixture
def ropefit(tmp_path: Path) -> Command:
    """The command line, started in a fresh directory."""
    return Command(tmp_path)
