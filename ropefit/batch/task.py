"""One recording of a batch, in whatever process it runs: all stages, and the record of them."""

from __future__ import annotations

import os
import socket
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ropefit.api import runs, summaries
from ropefit.api.pipeline import COMPUTED
from ropefit.artifacts import Model
from ropefit.batch.records import Record, State, read_record, write_record
from ropefit.batch.results import results
from ropefit.failures import as_failure, one_line
from ropefit.runs.code import code_sha256
from ropefit.runs.loading import load
from ropefit.runs.lock import Busy, working_on
from ropefit.runs.protocol import Context
from ropefit.runs.run_directory import REPORT

Summary = dict[str, Any]

STAGES = ("preprocess", "identify", "diagnose", "control", "report")


@dataclass(frozen=True)
class Task:
    """What a worker needs to know: text and numbers only, so that it may travel.

    settings: of preprocess, identify and control; until: the last stage wanted; key: of settings
    and code; code: hash of the source that the batch was started with; session: the call.
    """

    name: str
    recording: str
    runs: str
    settings: dict[str, dict[str, Any]]
    until: str
    key: str
    code: str
    session: str


def code_of_stages() -> str:
    """Return the hash of the code of every stage that computes; the report only shows."""
    return code_sha256(*(stage.module for stage in COMPUTED))


def run_task(task: Task) -> tuple[str, State, str]:
    """Compute one recording as far as it is not up to date: (name, state, message).

    Nothing it does can fail the batch; what happened is in its record. A run that another process
    works on is left alone, its record too.
    """
    try:
        with working_on(Path(task.runs) / task.name), warnings.catch_warnings(action="ignore"):
            record = _Progress(task).compute()
    except Busy as error:
        return task.name, "busy", one_line(error)
    except Exception as error:  # not even the record can be written
        return task.name, "failed", one_line(as_failure(error))
    return task.name, record.state, record.message


class _Progress:
    """A task under way, and its record."""

    def __init__(self, task: Task):
        self.task, self.runs = task, Path(task.runs)
        self.directory = self.runs / task.name
        self.before = read_record(self.runs, task.name)
        known = self.before if self.before and self.before.key == task.key else None
        self.record = Record(
            name=task.name,
            recording=task.recording,
            state="running",
            key=task.key,
            session=task.session,
            attempts=(self.before.attempts if self.before else 0) + 1,
            computed=known.computed if known else [],
            seconds=known.seconds if known else {},
            results=known.results if known else {},
            process=f"{socket.gethostname()}:{os.getpid()}",
        )

    def compute(self) -> Record:
        """Return every stage; the record that is left."""
        fresh: list[str] = []
        try:
            if code_of_stages() != self.task.code:
                raise RuntimeError("this worker has other code than the one that started the batch")
            for stage in STAGES[: STAGES.index(self.task.until) + 1]:
                if self._stage(stage, fresh):
                    fresh.append(stage)
        except Exception as error:  # whatever it is, the other recordings go on
            failure = as_failure(error)
            self._note(state="failed", message=one_line(failure), exit_code=failure.exit_code)
        else:
            if not fresh and self.before and self.before.state == "done":
                write_record(self.runs, self.before)  # nothing happened
                return self.before
            self._note(state="done", stage="")
        self._note(sizes=_sizes(self.directory), peak=_peak_memory())
        write_record(self.runs, self.record)
        return self.record

    def _stage(self, stage: str, fresh: list[str]) -> bool:
        """Return whether it computed anything."""
        work = _WORK[stage]
        self._note(stage=stage)
        write_record(self.runs, self.record)
        started = time.monotonic()
        data = work(self.task, self.directory, self.record, fresh)
        if data is None:
            return False
        if data.get("computed", True):
            seconds = round(time.monotonic() - started, 3)
            self._note(
                computed=[*self.record.computed, stage],
                seconds={**self.record.seconds, stage: seconds},
            )
        self._note(results={**self.record.results, **results(stage, data)})
        return data.get("computed", True)

    def _note(self, **changes: Any) -> None:
        self.record = self.record.model_copy(update=changes)


def _preprocess(task: Task, run: Path, record: Record, fresh: list[str]) -> Summary:
    given, recording = task.settings["preprocess"], Path(task.recording)
    # A run is called after its recording: another one of that name takes its place.
    return summaries.preprocessed(runs.preprocess(recording, run, given, Context(), replaces=True))


def _identify(task: Task, run: Path, record: Record, fresh: list[str]) -> Summary:
    return summaries.identified(runs.identify(run, task.settings["identify"], Context()))


def _diagnose(task: Task, run: Path, record: Record, fresh: list[str]) -> Summary | None:
    if not runs.diagnosable(load(run, Model)[0]):
        return None
    return summaries.diagnosed(runs.diagnose(run, {}, Context()))


def _control(task: Task, run: Path, record: Record, fresh: list[str]) -> Summary | None:
    if not runs.controllable(load(run, Model)[0]):
        return None
    return summaries.controlled(runs.control_by(run, task.settings["control"]["loss"], Context()))


def _report(task: Task, run: Path, record: Record, fresh: list[str]) -> Summary | None:
    from ropefit.stages.report import write_report

    last = record.computed[-1] if record.computed else ""
    if not fresh and last == "report" and (run / REPORT).exists():
        return None
    return {"stage": "report", "report": str(write_report(run, lambda sentence: None))}


_WORK = {
    "preprocess": _preprocess,
    "identify": _identify,
    "diagnose": _diagnose,
    "control": _control,
    "report": _report,
}


def _sizes(directory: Path) -> dict[str, int]:
    """Return bytes of every file of a run."""
    return {
        path.name: path.stat().st_size
        for path in sorted(directory.iterdir())
        if path.is_file() and not path.name.startswith(".")
    }


def _peak_memory() -> int:
    """Return bytes, the most this process ever held; 0 where the system does not say."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if os.uname().sysname == "Darwin" else 1024 * peak
