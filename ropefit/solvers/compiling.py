"""Say when compiled code is made: once a machine and a version, not in every stage of a first run.

numba compiles each loop when it is first used and keeps it in a cache folder. The sentence is for
all of them: a mark beside the cache says that it has been said.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

COMPILING = (
    "compiling the solvers for this machine; this happens once and takes about a minute in all "
    "(nothing is wrong; `ropefit warm-up` does it ahead)"
)
PACKAGE = Path(__file__).parents[1]
MARK = ".ropefit-compiling-"  # a file of this name beside numba's cache: it has been said


_listeners: list[Callable[[str], None]] = []  # by whom compilation is said, the innermost last


@contextmanager
def telling(say: Callable[[str], None]) -> Iterator[None]:
    """Say the first compilation by numba meanwhile; loading its cache is not said.

    Nothing is said where it was said before on this machine, for the same source. numba may be
    imported meanwhile: `kernels/jit.py` calls `listen`.
    """
    if "numba" in sys.modules:
        listen()
    _listeners.append(say)
    try:
        yield
    finally:
        _listeners.pop()


@cache
def listen() -> None:
    """Hear of numba's compilations from now on."""
    from numba.core import event

    class Telling(event.Listener):
        def on_start(self, event: Any) -> None:
            if not _listeners or _listeners[-1] is _silent:
                return
            say, _listeners[-1] = (
                _listeners[-1],
                _silent,
            )  # only the first is an entry point for certain
            if not said(event.data["dispatcher"]):
                say(COMPILING)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Telling())


def _silent(text: str) -> None:
    """Take the place of what has said it."""


def said(dispatcher: Any) -> bool:
    """Return whether a mark of this source lies beside numba's cache; it does from now on."""
    kept = dispatcher.stats.cache_path
    if kept is None:  # not cached: compiled in every process
        return False
    mark = folder_beside(Path(kept)) / f"{MARK}{_source()}"
    try:
        if mark.exists():
            return True
        mark.parent.mkdir(parents=True, exist_ok=True)
        for old in mark.parent.glob(f"{MARK}*"):
            old.unlink(missing_ok=True)
        mark.touch()
    except OSError:  # a folder that cannot be written: said once in every stage
        pass
    return False


def folder_beside(kept: Path) -> Path:
    """Return one folder for all of ropefit's loops; numba has one for each folder of source."""
    if kept.is_relative_to(PACKAGE):
        return PACKAGE / "__pycache__"
    return kept if kept.name == "__pycache__" else kept.parent


@cache
def _source() -> str:
    """Return a hash of the solvers' source and of numba's version: what compiled code depends
    on."""
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
