"""What is known of each task: one small JSON file, written whole or not at all."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ropefit.artifacts.atomic import write_bytes
from ropefit.errors import StageFailed

FOLDER = ".batch"
State = Literal["running", "done", "failed", "busy"]


class Record(BaseModel):
    """One recording's task: how far it came, what it cost, what came out.

    key: settings and source code it was computed with; session: the call of `ropefit batch`.
    seconds: by stage; sizes: bytes of what the run holds; peak: bytes, the most its process ever
    held; attempts: how often it was begun in all.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str
    recording: str
    state: State
    key: str
    session: str
    attempts: int = 0
    stage: str = ""
    message: str = ""
    exit_code: int = 0
    computed: list[str] = Field(default_factory=list)
    seconds: dict[str, float] = Field(default_factory=dict)
    sizes: dict[str, int] = Field(default_factory=dict)
    peak: int = 0
    process: str = ""
    results: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True)
class Batch:
    """What is known of all recordings of a batch; runs: the folder of their runs."""

    runs: Path
    records: list[Record]

    def counts(self) -> dict[str, int]:
        """Return how many recordings are in each state."""
        states = ("done", "failed", "busy", "running")
        return {s: sum(r.state == s for r in self.records) for s in states}

    def check(self) -> None:
        """Raise StageFailed if any recording is not done."""
        left = [r for r in self.records if r.state != "done"]
        if left:
            raise StageFailed(
                f"{len(left)} of {len(self.records)} recordings are not done, the first "
                f"{left[0].name}: {left[0].message or left[0].state}; see "
                f"{self.runs / 'index.html'}, compute failed ones again with --retry"
            )


def record_path(runs: Path, name: str) -> Path:
    """Return where the record of a run is kept."""
    return runs / FOLDER / f"{name}.json"


def read_record(runs: Path, name: str) -> Record | None:
    """Return the record of a run; None if there is none that can be read."""
    try:
        return Record.model_validate_json(record_path(runs, name).read_bytes())
    except (OSError, ValidationError):
        return None


def write_record(runs: Path, record: Record) -> None:
    """Write atomically. Raises StageFailed."""
    write_text(record_path(runs, record.name), json.dumps(record.model_dump(), allow_nan=False))


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, its folder made if need be. Raises StageFailed."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, text.encode())
    except OSError as error:
        raise StageFailed(f"cannot write {path}: {error.strerror}; give another --runs")
