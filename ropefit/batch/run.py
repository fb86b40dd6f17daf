"""A batch: which tasks are left, what comes of them, what to do when a process dies."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ropefit.batch.engines import Dask, Engine, Local, WorkerDied
from ropefit.batch.index import write_index
from ropefit.batch.names import find_recordings
from ropefit.batch.records import Batch, Record, read_record, write_record
from ropefit.batch.task import Task, code_of_stages
from ropefit.errors import StageFailed, WrongUsage
from ropefit.runs.protocol import Context

Settings = dict[str, dict[str, Any]]
Done = Callable[[str], None]  # called with the name of every task that ended


def run_batch(
    recordings: list[Path],
    runs: Path,
    settings: Settings,
    until: str = "report",
    engine: str = "local",
    scheduler: str | None = None,
    workers: int | None = None,
    retry: bool = False,
    context: Context | None = None,
) -> Batch:
    """Compute every recording that is not up to date; write `index.html` and a table into `runs`.

    Recordings that failed before with the same settings and code are listed and not computed,
    unless `retry`. What failed is in the records: see `Batch.check`.
    """
    if scheduler is not None and engine != "dask":
        raise WrongUsage("--scheduler belongs to --engine dask")
    if workers is not None and engine == "dask":
        raise WrongUsage("--workers counts processes of this machine; a scheduler has its own")
    context = context or Context()
    found = find_recordings(recordings)
    if runs.exists() and not runs.is_dir():
        raise WrongUsage(f"{runs}: is a file, not a directory; give another --runs")
    tasks = _tasks(found, runs, settings, until)
    left = [task for task in tasks if retry or not _failed_before(task)]
    context.say(f"batch: {len(tasks)} recordings, {len(tasks) - len(left)} of them failed before")
    busy: dict[str, str] = {}
    count = 0

    def ended(name: str) -> None:
        nonlocal count
        count += 1
        context.progress(count / max(len(left), 1), f"{count} of {len(left)}, last {name}")

    chosen: Engine = Dask(scheduler) if engine == "dask" else Local(workers)
    try:
        busy = _work_through(chosen, left, ended)
    finally:  # also of a batch that was stopped: what is there is listed
        records = [_record(task, busy) for task in tasks]
        write_index(runs, records)
    return Batch(runs, records)


def _tasks(found: dict[str, Path], runs: Path, settings: Settings, until: str) -> list[Task]:
    code = code_of_stages()
    text = json.dumps([settings, until, code], sort_keys=True)
    key = hashlib.sha256(text.encode()).hexdigest()
    session = uuid.uuid4().hex
    return [
        Task(name, str(path.absolute()), str(runs.absolute()), settings, until, key, code, session)
        for name, path in found.items()
    ]


def _failed_before(task: Task) -> bool:
    record = read_record(Path(task.runs), task.name)
    return record is not None and record.state == "failed" and record.key == task.key


def _work_through(engine: Engine, tasks: list[Task], ended: Done) -> dict[str, str]:
    """Run tasks until all have ended; {name: by whom} of runs that others work on.

    When a process dies (killed, out of memory) all it is known of is which tasks were under way.
    These are run again one at a time: the one that kills its process again has failed.
    """
    busy: dict[str, str] = {}
    left = {task.name: task for task in tasks}

    def run(part: list[Task]) -> None:
        for name, state, message in engine.run(part):
            if name in left:
                del left[name]
                ended(name)
            if state == "busy":
                busy[name] = message

    while left:
        try:
            run(list(left.values()))
            return busy
        except WorkerDied:
            under_way = [task for task in left.values() if _is_under_way(task)]
        for task in left.copy().values():
            if _has_ended(task):  # its result was lost with the process
                del left[task.name]
                ended(task.name)
        if not under_way:
            raise StageFailed("processes die before they begin; see the memory and the system log")
        for task in under_way:
            try:
                run([task])
            except WorkerDied:
                _write_off(task)
                left.pop(task.name, None)
                ended(task.name)
    return busy


def _is_under_way(task: Task) -> bool:
    record = read_record(Path(task.runs), task.name)
    return record is not None and record.session == task.session and record.state == "running"


def _has_ended(task: Task) -> bool:
    record = read_record(Path(task.runs), task.name)
    return record is not None and record.session == task.session and record.state != "running"


def _write_off(task: Task) -> None:
    record = read_record(Path(task.runs), task.name)
    assert record is not None
    message = (
        f"the process died twice in {record.stage}: killed, or out of memory; see the system log"
    )
    write_record(
        Path(task.runs),
        record.model_copy(update={"state": "failed", "message": message, "exit_code": 1}),
    )


def _record(task: Task, busy: dict[str, str]) -> Record:
    """Return what is known of a task now."""
    record = read_record(Path(task.runs), task.name)
    empty = Record(
        name=task.name, recording=task.recording, state="running", key="", session=task.session
    )
    record = record or empty
    if task.name in busy:
        return record.model_copy(update={"state": "busy", "message": busy[task.name]})
    if record.state == "running":
        return record.model_copy(update={"message": "not finished"})
    return record
