"""Kill -9, a full disk, a directory that cannot be written, two processes on one run."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from ropefit.api import runs
from ropefit.artifacts import Observations, read
from ropefit.errors import StageFailed
from ropefit.runs import checkpoint
from ropefit.runs.lock import Busy, working_on
from ropefit.runs.protocol import Context
from tests.conftest import ROOT
from tests.factories import marker_recording


def preprocess(folder: Path, nodes: int, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ropefit", "preprocess", "in", "--run", "run", "--nodes", str(nodes),
         "--quiet"],
        cwd=folder, capture_output=True, text=True, timeout=300, check=False, **options,
    )  # fmt: skip


def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    marker_recording(tmp_path / "in")
    assert preprocess(tmp_path, 6).returncode == 0
    path = tmp_path / "run" / "observations.h5"
    before = path.read_bytes()

    def limit() -> None:  # no file may grow beyond half of what is to be written
        most = len(before) // 2
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    result = preprocess(tmp_path, 9, preexec_fn=limit)
    assert result.returncode == 1
    assert result.stderr.startswith("ropefit: cannot write run/observations.h5")
    assert result.stderr.count("\n") == 1
    assert path.read_bytes() == before
    assert os.listdir(tmp_path / "run") == ["observations.h5"]
    assert preprocess(tmp_path, 9).returncode == 0
    assert len(read(path, Observations)[0].node_arc) == 9


def test_two_processes_on_one_run(tmp_path: Path) -> None:
    marker_recording(tmp_path / "in")
    command = [sys.executable, "-m", "ropefit", "preprocess", "in", "--run", "run", "--quiet"]
    both = [
        subprocess.Popen(
            [*command, "--nodes", nodes], cwd=tmp_path, stderr=subprocess.PIPE, text=True
        )
        for nodes in ("6", "7")
    ]
    ended = [(process.communicate()[1], process.returncode) for process in both]
    assert all(code == 0 or "is working on it" in error for error, code in ended)
    assert any(code == 0 for _, code in ended)
    assert len(read(tmp_path / "run" / "observations.h5", Observations)[0].node_arc) in (6, 7)
    assert os.listdir(tmp_path / "run") == ["observations.h5"]


def test_a_lock_is_for_one_process_and_leaves_nothing(tmp_path: Path) -> None:
    run = tmp_path / "a" / "run"
    code = (
        "import sys, pathlib\nfrom ropefit.errors import StageFailed\n"
        "from ropefit.runs.lock import working_on\n"
        "try:\n with working_on(pathlib.Path(sys.argv[1])): print('free')\n"
        "except StageFailed as error: print(error)\n"
    )

    def other() -> str:
        command = [sys.executable, "-c", code, str(run)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    with working_on(run), working_on(run):
        (run / ".observations.h5.x.tmp").touch()
        assert f"process {os.getpid()} on " in other()
    assert (run / ".observations.h5.x.tmp").exists()
    assert other() == "free\n"
    assert os.listdir(run) == []  # what a dead process left was removed
    with working_on(tmp_path / "b" / "run"):
        pass
    assert not (tmp_path / "b").exists()  # folders that were made for it and stayed empty
    assert issubclass(Busy, StageFailed)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_directory_that_cannot_be_written(tmp_path: Path) -> None:
    marker_recording(tmp_path / "in")
    assert preprocess(tmp_path, 6).returncode == 0
    (tmp_path / "run").chmod(0o500)
    try:
        assert preprocess(tmp_path, 6).returncode == 0  # up to date: nothing to write
        result = preprocess(tmp_path, 7)
        assert result.returncode == 1
        assert "cannot be written" in result.stderr
    finally:
        (tmp_path / "run").chmod(0o700)


def test_a_few_kills(tmp_path: Path) -> None:
    """A small part of `python -m benchmarks.robustness.kills`, in its own process: it forks."""
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.robustness.kills", "--kills", "12", "--chain", "0",
         "--until", "preprocess"],
        cwd=ROOT, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_lock_left_when_all_was_done_goes(tmp_path: Path) -> None:
    marker_recording(tmp_path / "in")
    assert preprocess(tmp_path, 6).returncode == 0
    for name in (".lock", ".observations.h5.x.tmp"):
        (tmp_path / "run" / name).touch()
    assert preprocess(tmp_path, 6).returncode == 0  # up to date
    assert [path.name for path in (tmp_path / "run").iterdir() if path.name.startswith(".")] == []


def test_a_checkpoint_left_when_all_was_done_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that is killed after its output is written and before its checkpoint is removed."""
    recording, run = marker_recording(tmp_path / "in"), tmp_path / "run"
    left = run / "preprocess.checkpoint.h5"

    def preprocessed(nodes: int) -> bool:
        settings = {"nodes": nodes, "project": "auto"}
        return runs.preprocess(recording, run, settings, Context()).computed

    with monkeypatch.context() as killed:
        killed.setattr(checkpoint, "EVERY", 0)
        killed.setattr(checkpoint, "SELDOM", 0)
        killed.setattr(checkpoint.Saver, "remove", lambda self: None)
        assert preprocessed(6)
    assert left.exists()
    of_six = left.read_bytes()
    assert not preprocessed(6)
    assert not left.exists()
    assert preprocessed(7)
    left.write_bytes(of_six)
    assert not preprocessed(7)
    assert left.exists()  # of other settings: it may be resumed
