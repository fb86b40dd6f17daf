"""Runs of all stages that count their steps of writing, or kill their process at one of them."""

from __future__ import annotations

import os
import re
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from ropefit.api import runs
from ropefit.artifacts import ARTIFACTS
from ropefit.artifacts.store import identity, read
from ropefit.runs import checkpoint
from ropefit.runs.journal import Entries
from ropefit.runs.protocol import Context
from ropefit.runs.run_directory import REPORT
from ropefit.stages.report import write_report

TIMES = re.compile(r'<td data-label="(took|created)">.*?</td>')  # what a page says of its making
RESUMED = 255  # what a process tells instead of a stage's number
FAST = {"solver": "thomas", "steps": 4, "iterations": 3, "evaluations": 25, "free": ["eta_x_G"]}
STEPS = [  # of writing: where a process may die between two of them
    (os, "replace"), (os, "fsync"), (os, "chmod"), (os, "unlink"), (tempfile, "mkstemp"),
    (h5py.Group, "create_dataset"), (h5py.File, "__init__"), (h5py.File, "close"),
]  # fmt: skip


@dataclass
class Chain:
    """What is run: its name, and for each of its two settings the calls, by stage."""

    name: str
    calls: list[list[tuple[str, Callable[[Path], Any]]]]
    files: list[dict[str, str]] = field(default_factory=list)  # {file: hash} by settings
    seconds: float = 0.0
    steps: int = 0


def chains(recording: Path) -> list[Chain]:
    """Return all stages with the paper's solver, and with the equilibrium and its diagnosis."""

    def observe(nodes: int) -> Callable[[Path], Any]:
        settings = {"nodes": nodes, "project": "auto"}
        return lambda run: runs.preprocess(recording, run, settings, Context())

    def fit(settings: dict[str, Any]) -> Callable[[Path], Any]:
        return lambda run: runs.identify(run, settings, Context())

    def estimate(run: Path) -> Any:
        return runs.control(run, {"evaluations": 15}, Context())

    def explain(run: Path) -> Any:
        return runs.diagnose(run, {"most_frames": 4}, Context())

    def tell(run: Path) -> Any:
        return write_report(run, lambda sentence: None)

    few = {"most_frames": 4}
    paper, equilibrium = (
        [
            [
                ("preprocess", observe(nodes)),
                ("identify", fit(settings)),
                *more,
                ("control", estimate),
                ("report", tell),
            ]
            for nodes in (6, 7)
        ]
        for settings, more in ((FAST, []), (few, [("diagnose", explain)]))
    )
    return [Chain("paper's solver", paper), Chain("equilibrium, diagnosis", equilibrium)]


def hashes(run: Path) -> dict[str, str]:
    """Return {file: hash of its content} of a run. Raises RopefitError at a damaged artifact."""
    found = {}
    for path in sorted(run.iterdir()) if run.exists() else []:
        if path.name.startswith("."):
            continue
        if path.name == REPORT:
            page = TIMES.sub("", path.read_text())
            found[path.name] = str(hash(page)) if page.rstrip().endswith("</html>") else "cut off"
            continue
        schema = identity(path)[0]
        kind = next(kind for kind in ARTIFACTS if kind.schema_name == schema)
        found[path.name] = read(path, kind)[1]
    return found


def run_chain(chain: Chain, which: int, run: Path, told: int | None = None) -> None:
    """Run all stages; write the number of the current one to file descriptor `told`."""
    for number, (_, call) in enumerate(chain.calls[which]):
        if told is not None:
            os.write(told, bytes([number]))
        call(run)


def count_steps(at: int | None) -> list[int]:
    """Count steps of writing in this process; at the given one it kills itself."""
    count = [0]

    def step() -> None:
        count[0] += 1
        if at is not None and count[0] == at:
            os.kill(os.getpid(), signal.SIGKILL)

    def counted(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            step()
            result = function(*arguments, **options)
            step()
            return result

        return call

    for owner, name in STEPS:
        setattr(owner, name, counted(getattr(owner, name)))
    return count


def tell_resumed(told: int) -> None:
    """Tell file descriptor `told` of every stage that goes on from what was found before."""
    restored = checkpoint.Saver.restored

    def telling(self: checkpoint.Saver) -> Entries:
        entries = restored(self)
        if entries:
            os.write(told, bytes([RESUMED]))
        return entries

    checkpoint.Saver.restored = telling


def prepare(chain: Chain, scratch: Path) -> None:
    """Run undisturbed: note the files, the time and the number of steps of writing."""
    for which in (0, 1):
        run = scratch / f"reference {chain.name} {which}"
        run_chain(chain, which, run)
        chain.files.append(hashes(run))
    read_end, write_end = os.pipe()
    started = time.monotonic()
    if os.fork() == 0:  # what it costs when all is compiled, apart from the first run's start
        count = count_steps(None)
        run_chain(chain, 0, scratch / f"timed {chain.name}")
        os.write(write_end, str(count[0]).encode())
        os._exit(0)
    os.wait()
    chain.seconds = time.monotonic() - started
    chain.steps = int(os.read(read_end, 100))
