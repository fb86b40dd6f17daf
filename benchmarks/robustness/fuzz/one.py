"""Fuzz one reader in this process.

A finding is whatever is none of ropefit's own failures, a warning, a file touched outside the
source's folder, a program started, or something unpickled. Executions go on after one. A hang of
10 s, a crash or 2 GB of memory end the process (libFuzzer tells them).
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import atheris

HANG = 10  # s
MEMORY = 2048  # MB
FORBIDDEN = ("os.system", "os.exec", "os.posix_spawn", "pickle.find_class", "socket.connect")
SHOWN = 2000  # characters of a finding


class Watch:
    """Refuses, while it is on, what a reader has no reason to do."""

    def __init__(self, allowed: Path):
        self.on = False
        self.writable = str(allowed.resolve())
        self.readable = (self.writable, sys.prefix, sys.base_prefix, "/proc", "/sys", "/dev")
        self.readable += ("/usr", "/etc/localtime", str(Path.cwd()))
        self.broken: list[str] = []
        sys.addaudithook(self._see)

    def _see(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event in FORBIDDEN or (event == "subprocess.Popen" and "c3d" not in self.writable):
            self.broken.append(f"{event} {str(arguments)[:200]}")
        if event == "open" and isinstance(arguments[0], (str, bytes)):
            self._open(os.fsdecode(arguments[0]), arguments[1], arguments[2])

    def _open(self, name: str, mode: str | None, flags: int) -> None:
        path = os.path.realpath(name) if "\0" not in name else ""
        writes = bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        allowed = (self.writable, "/dev/null") if writes else self.readable
        if not path.startswith(allowed):
            self.broken.append(f"open {path[:200]} {mode}")


class Harness:
    """Runs a target on bytes and keeps count."""

    def __init__(self, name: str, state: Path, holder: Path):
        from benchmarks.robustness.fuzz.targets import TARGETS
        from ropefit.errors import RopefitError

        self.failure = RopefitError
        make, pattern, self.read = TARGETS[name]
        self.folder = holder / "source"
        make(self.folder)
        self.file = sorted(self.folder.glob(pattern))[0]
        self.seed = self.file.read_bytes()
        self.read(self.folder)  # so that no execution pays for imports
        self.watch = Watch(holder)
        self.log = state / f"{slug(name)}.json"
        self.count, self.refused, self.saved = 0, 0, 0.0
        self.findings: dict[str, str] = {}

    def __call__(self, data: bytes) -> None:
        self.file.write_bytes(data)
        self.count += 1
        self.watch.on = True
        try:
            with warnings.catch_warnings(action="error"):
                warnings.simplefilter("ignore", DeprecationWarning)
                warnings.simplefilter("ignore", ResourceWarning)
                self.read(self.folder)
        except self.failure:
            self.refused += 1
        except Exception as error:
            self.watch.on = False
            self._found(error, data)
        finally:
            self.watch.on = False
        if self.watch.broken:
            self._found(PermissionError(self.watch.broken[0]), data)
            self.watch.broken.clear()
        if time.monotonic() > self.saved + 0.5:  # libFuzzer ends the process without a word
            self.save()

    def _found(self, error: Exception, data: bytes) -> None:
        where = traceback.extract_tb(error.__traceback__)[-1:]
        key = f"{type(error).__name__} at " + "".join(f"{f.filename}:{f.lineno}" for f in where)
        if key not in self.findings:
            self.findings[key] = "".join(traceback.format_exception(error))[-SHOWN:]
            (self.log.with_suffix(f".{len(self.findings)}.input")).write_bytes(data)
            self.save()

    def save(self) -> None:
        """Save the counts so far, atomically."""
        self.saved = time.monotonic()
        data = {"executions": self.count, "refused": self.refused, "findings": self.findings}
        temporary = self.log.with_suffix(".tmp")
        temporary.write_text(json.dumps(data))
        os.replace(temporary, self.log)


def slug(name: str) -> str:
    """Return a target's name as a file name."""
    return "".join(c if c.isalnum() or c == "." else "_" for c in name)


def fuzz(name: str, seconds: int, seed: int, state: Path) -> None:
    """Fuzz for some seconds; counts and findings go to the state folder. Ends the process."""
    memory = Path("/dev/shm")
    holder = Path(tempfile.mkdtemp(prefix=slug(name), dir=memory if memory.is_dir() else None))
    tempfile.tempdir = str(holder)
    harness = Harness(name, state, holder)
    corpus = state / "corpus" / slug(name)
    corpus.mkdir(parents=True, exist_ok=True)
    (corpus / "valid").write_bytes(harness.seed)
    arguments = [
        f"-max_total_time={seconds}",
        f"-seed={seed}",
        f"-timeout={HANG}",
        f"-rss_limit_mb={MEMORY}",
        f"-max_len={4 * len(harness.seed) + 64}",
        f"-dict={state / 'words'}",
        f"-artifact_prefix={state}/{slug(name)}.",
        "-verbosity=0",
    ]
    atheris.Setup([sys.argv[0], *arguments, str(corpus)], harness)
    try:
        atheris.Fuzz()
    finally:
        harness.save()
        shutil.rmtree(holder, ignore_errors=True)
