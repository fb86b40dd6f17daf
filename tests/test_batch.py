"""`ropefit batch`: failures apart, nothing computed twice, dead workers, a real scheduler."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ropefit.batch import run as driver
from ropefit.batch.engines import Result, WorkerDied
from ropefit.batch.index import summary
from ropefit.batch.names import find_recordings
from ropefit.batch.records import Record, read_record, write_record
from ropefit.batch.run import run_batch
from ropefit.batch.task import Task, run_task
from ropefit.errors import BadInput, StageFailed, WrongUsage
from tests.factories import marker_recording

SETTINGS = {"preprocess": {"nodes": 6, "project": "auto"}, "identify": {}, "control": {}}


def recordings(folder: Path, count: int) -> Path:
    for number in range(count):
        marker_recording(folder / f"take{number}")
    return folder


def call(given: Path, runs: Path, **options) -> dict:
    """The summary of a batch. Raises StageFailed where a recording is not done."""
    done = run_batch([given], runs, SETTINGS, "preprocess", **options)
    done.check()
    return summary(done)


class Here:
    """An engine in this process; a task may be made to die."""

    def __init__(self, deadly: str = ""):
        self.deadly, self.ran = deadly, []

    def run(self, tasks: list[Task]) -> Iterator[Result]:
        for task in tasks:
            self.ran.append(task.name)
            if task.name == self.deadly:
                write_record(
                    Path(task.runs),
                    Record(
                        name=task.name, recording=task.recording, state="running", key=task.key,
                        session=task.session, stage="preprocess",
                    ),
                )  # fmt: skip
                raise WorkerDied
            yield run_task(task)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> Here:
    engine = Here()
    monkeypatch.setattr(driver, "Local", lambda workers: engine)
    return engine


def times(runs: Path) -> dict[str, int]:
    return {str(p): p.stat().st_mtime_ns for p in runs.glob("*/*.h5")}


def test_names(tmp_path: Path) -> None:
    for name in ("a/take1", "b/take1", "b/take2"):
        marker_recording(tmp_path / name)
    assert list(find_recordings([tmp_path])) == ["a/take1", "b/take1", "b/take2"]
    assert list(find_recordings([tmp_path / "a/take1", tmp_path / "a/take1"])) == ["take1"]
    with pytest.raises(WrongUsage, match="take1"):
        find_recordings([tmp_path / "a", tmp_path / "b"])
    with pytest.raises(BadInput, match="no folder below"):
        find_recordings([_empty(tmp_path)])
    with pytest.raises(BadInput, match="no such"):
        find_recordings([tmp_path / "none"])


def _empty(folder: Path) -> Path:
    (folder / "empty").mkdir()
    return folder / "empty"


def test_failures_stay_apart_and_are_retried_on_request(tmp_path: Path, here: Here) -> None:
    given = recordings(tmp_path / "in", 3)
    spoiled = given / "take1" / "markers.csv"
    good = spoiled.read_text()
    spoiled.write_text("junk")
    runs = tmp_path / "runs"
    with pytest.raises(StageFailed, match=r"1 of 3 .* take1: .*markers.csv"):
        call(given, runs)
    first = times(runs)
    assert len(first) == 2
    with (runs / "summary.csv").open() as file:
        states = {row["recording"]: row["state"] for row in csv.DictReader(file)}
    assert states == {"take0": "done", "take1": "failed in preprocess", "take2": "done"}
    assert "take1" in (runs / "index.html").read_text()
    spoiled.write_text(good)
    here.ran.clear()
    with pytest.raises(StageFailed, match="1 of 3"):
        call(given, runs)  # what failed is listed, not computed
    assert here.ran == ["take0", "take2"]
    found = call(given, runs, retry=True)
    assert (found["done"], found["failed"]) == (3, 0)
    assert {name: at for name, at in times(runs).items() if name in first} == first
    assert {r["name"]: r["attempts"] for r in found["recordings"]} == {
        "take0": 1, "take1": 2, "take2": 1,
    }  # fmt: skip


def test_a_changed_recording_is_computed_again(tmp_path: Path, here: Here) -> None:
    given, runs = recordings(tmp_path / "in", 2), tmp_path / "runs"
    call(given, runs)
    before = times(runs)
    markers = given / "take0" / "markers.csv"
    markers.write_text(markers.read_text().replace("0.7", "0.7001", 1))
    call(given, runs)
    changed = {Path(p).parent.name for p, at in times(runs).items() if at != before[p]}
    assert changed == {"take0"}


def test_a_task_that_kills_its_process_is_found_out(tmp_path: Path, here: Here) -> None:
    given, runs = recordings(tmp_path / "in", 3), tmp_path / "runs"
    here.deadly = "take1"
    with pytest.raises(StageFailed, match="take1: the process died twice in preprocess"):
        call(given, runs)
    assert here.ran == ["take0", "take1", "take1", "take2"]
    assert len(times(runs)) == 2


def test_a_run_that_another_process_holds_is_left_alone(tmp_path: Path, here: Here) -> None:
    given, runs = recordings(tmp_path / "in", 2), tmp_path / "runs"
    code = (
        "import sys, pathlib\nfrom ropefit.runs.lock import working_on\n"
        "with working_on(pathlib.Path(sys.argv[1])):\n print('held', flush=True)\n input()\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(runs / "take0")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(StageFailed, match=f"process {holder.pid} on .* is working on it"):
            call(given, runs)
        assert read_record(runs, "take0") is None
        assert len(times(runs)) == 1
    finally:
        holder.kill()
        holder.wait()
    assert call(given, runs)["done"] == 2  # the system took the lock back
    assert not (runs / "take0" / ".lock").exists()


def test_wrong_usage(tmp_path: Path) -> None:
    given = recordings(tmp_path / "in", 1)
    with pytest.raises(WrongUsage, match="--scheduler"):
        call(given, tmp_path / "runs", scheduler="tcp://x:1")
    with pytest.raises(WrongUsage, match="--scheduler ADDRESS"):
        call(given, tmp_path / "runs", engine="dask")
    (tmp_path / "file").touch()
    with pytest.raises(WrongUsage, match="is a file"):
        call(given, tmp_path / "file")


def test_through_the_command_line(ropefit, tmp_path: Path) -> None:
    given = recordings(tmp_path / "in", 3)
    (given / "take2" / "ends.csv").unlink()
    options = ["batch", given, "--runs", "runs", "--until", "preprocess", "--nodes", "6"]
    result = ropefit(*options, "--workers", "2", "--json", code=1)
    data = json.loads(result.stdout)
    assert (data["done"], data["failed"]) == (2, 1)
    failed = next(r for r in data["recordings"] if r["state"] == "failed")
    assert failed["exit_code"] == 3
    assert "ends.csv" in failed["message"]
    assert result.stderr.count("\nropefit: ") == 1


def _address(scheduler: subprocess.Popen[str], port: int) -> str:
    for _ in range(600):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return f"tcp://127.0.0.1:{port}"
        assert scheduler.poll() is None
        time.sleep(0.1)
    raise AssertionError("no scheduler")


def test_a_worker_of_a_cluster_is_killed_in_mid_task(ropefit, tmp_path: Path) -> None:
    """A scheduler, two workers, one killed -9 while it computes: all there, none twice."""
    pytest.importorskip("distributed")
    given = recordings(tmp_path / "in", 8)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    local = {**os.environ, "OMP_NUM_THREADS": "1"}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    processes = [
        subprocess.Popen(
            [*dask, "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
            cwd=tmp_path,
            text=True,
            stderr=subprocess.DEVNULL,
            env=local,
        )
    ]
    try:
        address = _address(processes[0], port)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-nanny"]
        worker += ["--nthreads", "1", "--no-dashboard"]
        processes += [
            subprocess.Popen(worker, cwd=tmp_path, stderr=subprocess.DEVNULL, env=local)
            for _ in range(2)
        ]
        options = ["batch", str(given), "--runs", "runs", "--until", "preprocess", "--json"]
        options += ["--engine", "dask", "--scheduler", address]
        batch = subprocess.Popen(
            [sys.executable, "-m", "ropefit", *options],
            cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=local,
        )  # fmt: skip
        victim = _first_at_work(tmp_path / "runs" / ".batch")
        os.kill(victim, signal.SIGKILL)
        out, error = batch.communicate(timeout=300)
        assert batch.returncode == 0, error
    finally:
        for process in processes:
            process.kill()
            process.wait()
    data = json.loads(out)
    assert data["done"] == 8
    computed = [read_record(tmp_path / "runs", r["name"]) for r in data["recordings"]]
    assert all(record and record.computed == ["preprocess"] for record in computed)
    by = {record.process for record in computed if record}
    assert len(by) <= 2
    assert {int(re.sub(r".*:", "", name)) for name in by} - {victim}


def _first_at_work(folder: Path) -> int:
    """Process id of the first worker whose task is under way."""
    for _ in range(6000):
        for path in folder.glob("*.json"):
            record = read_record(folder.parent, path.stem)
            if record and record.state == "running":
                return int(record.process.rpartition(":")[2])
        time.sleep(0.01)
    raise AssertionError("nothing was begun")
