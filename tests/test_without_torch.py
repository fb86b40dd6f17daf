"""What answers without torch: all but the paper's searches, control, and the rope in torch."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT, SAMPLES, Command
from tests.test_motion_runs import recorded

# These modules import torch, and only these.
ISLANDS = {
    "": ("differentiable",),
    "adapters": ("control_rope", "gripped"),
    "fitting": ("search", "searched", "weights"),
    "inference": ("bfgs", "control", "identify", "search_space"),
    "models": ("equilibrium_rope", "gripped_rope", "rope", "xpbd_rope"),
    "solvers.batched": ("implicit", "ropes", "simulate", "solve", "threads"),
    "solvers.dynamics": ("differentiable",),
    "solvers.equilibrium": ("differentiable",),
    "solvers.xpbd": ("chain", "compiled", "jacobi", "reference", "thomas", "tridiagonal"),
    "stages": ("control",),
}
IMPORT = """
import importlib, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError as error:
        print(name, error)
"""
FEW = ["--most-frames", "8"]


@pytest.fixture
def no_torch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no process that is started find torch."""
    folder = tmp_path / "blocked"
    folder.mkdir()
    (folder / "torch.py").write_text('raise ImportError("torch is wanted")\n')
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(folder), str(ROOT)]))


def modules() -> list[str]:
    """Return all modules of the package but that which runs it."""
    paths = sorted((ROOT / "ropefit").rglob("*.py"))
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths]
    return [name.removesuffix(".__init__") for name in names if not name.endswith("__main__")]


def imported(*names: str) -> list[str]:
    """Return which of some modules cannot be imported, and why."""
    command = [sys.executable, "-c", IMPORT, *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_all_but_the_islands_are_imported_without_torch(no_torch: None) -> None:
    islands = {
        ".".join(part for part in ("ropefit", room, name) if part)
        for room, names in ISLANDS.items()
        for name in names
    }
    wanted = [f"{name} torch is wanted" for name in modules() if name in islands]
    assert len(wanted) == len(islands)
    assert imported(*modules()) == wanted


def test_a_rope_at_rest(ropefit: Command, no_torch: None) -> None:
    ropefit("preprocess", SAMPLES / "markers", "--nodes", "12")
    assert ropefit.json("identify", *FEW)["solver"] == "equilibrium"
    assert "verdict" in ropefit.json("diagnose", *FEW)
    assert Path(ropefit.directory / ropefit.json("report")["report"]).exists()
    ropefit("export", "--to", "json", "--out", "rope.json")
    wrong = ropefit("identify", "--solver", "thomas", *FEW, code=1)
    assert "torch is wanted" in wrong.stderr


def test_a_rope_in_motion(ropefit: Command, tmp_path: Path, no_torch: None) -> None:
    clip = recorded(tmp_path / "clip", sway=0.05)
    told = ropefit.json("run", clip, "--solver", "dynamics")
    assert told["identify"]["solver"] == "dynamics"
    assert "verdict" in told["diagnose"]
