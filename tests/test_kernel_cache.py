"""Compiled code kept on disk is compiled anew when any of its source files has changed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ropefit.rod import fields
from ropefit.solvers import dynamics, equilibrium, status, xpbd
from ropefit.solvers.kernels.jit import SHARED, source_key
from tests.conftest import ROOT

FOLDERS = [Path(room.__path__[0]) / "kernels" for room in (equilibrium, dynamics, xpbd)]
HELPER = """
from ropefit.solvers.kernels.jit import helper

@helper
def doubled(x):
    return 2.0 * x
"""
ENTRIES = """
from pathlib import Path
from ropefit.solvers.kernels.jit import kernel, source_key
from room.helpers import doubled

def _entries(sources):
    @kernel
    def entry(x):
        assert sources != 0
        return doubled(x)
    return entry

entry = _entries(source_key(Path(__file__).parent))
if __name__ == "__main__":
    print(entry(1.0), sum(entry.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.parent.name)
def test_every_source_file_is_part_of_the_key(folder: Path, tmp_path: Path) -> None:
    """A changed, a new and a missing file each change the key; so do the shared ones."""
    copy = Path(shutil.copytree(folder, tmp_path / "kernels"))
    shared = Path(shutil.copytree(SHARED, tmp_path / "shared"))
    files = [*sorted(copy.glob("*.py")), *sorted(shared.glob("*.py"))]
    assert len(files) > 5
    before = source_key(copy, shared)
    assert before == source_key(folder, SHARED)
    keys = {before}
    for file in files:
        text = file.read_text()
        file.write_text(text + "# changed\n")
        keys.add(source_key(copy, shared))
        file.write_text(text)
    assert len(keys) == 1 + len(files)
    (copy / "new.py").write_text("")
    assert source_key(copy, shared) not in keys
    (copy / "new.py").unlink()
    (copy / "entries.py").unlink()
    assert source_key(copy, shared) not in keys


def test_entry_points_know_all_that_is_compiled_into_them() -> None:
    """Every module outside its own folder that a kernels folder imports is part of its key."""
    extra = {Path(fields.__file__), Path(status.__file__)}
    for folder in FOLDERS:
        known = {*folder.glob("*.py"), *SHARED.glob("*.py")}
        text = "".join(file.read_text() for file in folder.glob("*.py"))
        used = {line.split()[1] for line in text.splitlines() if line.startswith("from ropefit.")}
        for module in used - {"ropefit.rod", "ropefit.solvers"}:
            path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
            assert path in known | extra, f"{folder.parent.name} imports {module}"
            if path in extra:
                assert path.stem in (folder / "entries.py").read_text().split("SOURCES")[1]


def test_a_changed_sibling_is_compiled_anew(tmp_path: Path) -> None:
    room = tmp_path / "room"
    room.mkdir()
    (room / "helpers.py").write_text(HELPER)
    (room / "entries.py").write_text(ENTRIES)

    def run() -> str:
        command = f"import sys; sys.path[:0] = [{str(tmp_path)!r}, {str(ROOT)!r}]; import runpy; "
        command += "runpy.run_module('room.entries', run_name='__main__')"
        done = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    assert run() == "2.0 0"
    assert run() == "2.0 1"
    (room / "helpers.py").write_text(HELPER.replace("2.0", "3.0"))
    assert run() == "3.0 0"
