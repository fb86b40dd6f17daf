"""What answers at once loads no solver: help, refusals, inspection, answers that are up to date."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.factories import marker_recording

HEAVY = ("torch", "numba", "open3d", "scipy", "cv2", "skimage", "joblib", "rosbags", "pandas")
# Of pictures, clouds, figures and batches: no work on markers loads them.
OF_OTHERS = (
    "open3d", "cv2", "skimage", "joblib", "rosbags", "matplotlib", "sympy", "pandas", "plotly",
    "scipy.stats", "torch._dynamo", "torch._inductor", "ropefit.fitting.motion",
)  # fmt: skip
CODE = """
import json, sys
from ropefit.cli import main
sys.argv = ["ropefit", *sys.argv[1:]]
try:
    main()
except SystemExit as end:
    code = end.code or 0
print(json.dumps([code, sorted(sys.modules)]), file=open("loaded.json", "w"))
"""
FAST = ["--solver", "thomas", "--steps", "2", "--iterations", "2", "--evaluations", "1"]
# Arguments, exit code, and what else must not be loaded.
NUMBERS = ("numpy", "h5py", "rich", "pydantic")
CASES: dict[str, tuple[list[str], int, tuple[str, ...]]] = {
    "help": (["--help"], 0, NUMBERS),
    "help of a command": (["identify", "--help"], 0, ("numpy", "h5py")),
    "version": (["--version"], 0, NUMBERS),
    "no such command": (["nonsense"], 2, ("numpy", "h5py")),
    "no such value": (["identify", "--loss", "OBJ77"], 2, ("numpy", "h5py")),
    "a value out of bounds": (["identify", "--steps", "0"], 2, ()),
    "a text that is no value": (["identify", "--start", "EI"], 2, ()),
    "options that exclude each other": (["identify", "--two-sided"], 2, ()),
    "inspect": (["inspect", "run"], 0, ()),
    "inspect nothing": (["inspect", "none"], 3, ()),
    "no such recording": (["preprocess", "none"], 3, ()),
    "another recording": (["preprocess", "other"], 2, ()),
    "no such recording, run": (["run", "none"], 3, ()),
    "no such run": (["identify", "--run", "none"], 1, ()),
    "no model": (["control"], 1, ()),
    "no such run, diagnose": (["diagnose", "--run", "none"], 1, ()),
    "no such run, report": (["report", "--run", "none"], 1, ()),
    "no such run, view": (["view", "--run", "none"], 1, ()),
    "no such run, export": (["export", "--to", "json", "--out", "x", "--run", "none"], 1, ()),
    "no such description": (["simulate", "none.toml", "--out", "x"], 3, ()),
    "no such recordings": (["batch", "none", "--runs", "x"], 3, ()),
    "preprocess, up to date": (["preprocess", "recording", "--nodes", "6"], 0, ()),
}


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two recordings, and a run of one with observations only."""
    folder = tmp_path_factory.mktemp("light")
    marker_recording(folder / "recording", frames=4)
    marker_recording(folder / "other", frames=3)
    command(folder, "preprocess", "recording", "--nodes", "6")
    return folder


def command(folder: Path, *arguments: str) -> tuple[int, list[str]]:
    """Exit code of the command line, and the modules that it loaded."""
    subprocess.run(
        [sys.executable, "-c", CODE, *arguments],
        cwd=folder, env={"PYTHONPATH": str(ROOT)}, capture_output=True, check=True,
    )  # fmt: skip
    code, loaded = json.loads((folder / "loaded.json").read_text())
    return code, loaded


@pytest.mark.parametrize("case", CASES)
def test_nothing_heavy_is_loaded(here: Path, case: str) -> None:
    arguments, code, more = CASES[case]
    found, loaded = command(here, *arguments)
    assert found == code
    assert "typer" in loaded
    assert not {*HEAVY, *more} & set(loaded)


def test_what_is_up_to_date_loads_no_solver(tmp_path: Path) -> None:
    marker_recording(tmp_path / "recording", frames=4)
    stages = (
        ["preprocess", "recording", "--nodes", "6"],
        ["identify", *FAST],
        ["control", "--evaluations", "1"],
    )
    for stage in stages:
        loaded = command(tmp_path, *stage)[1]
        assert "scipy" in loaded  # computed: the list says what is loaded
        assert stage[0] != "preprocess" or "torch" not in loaded
        allowed = {"cv2", "skimage"} if stage[0] == "preprocess" else set()  # for pictures
        assert not set(OF_OTHERS) & set(loaded) - allowed
    for stage in stages:
        code, loaded = command(tmp_path, *stage)
        assert code == 0
        assert not set(HEAVY) & set(loaded)
