"""One process at a time works on a run: a lock that the system takes back when its holder dies."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ropefit.errors import StageFailed

LOCK = ".lock"
_held: dict[tuple[str, int], int] = {}  # (run, thread) -> how many times it holds the lock


class Busy(StageFailed):
    """Another process works on the run."""


@contextmanager
def working_on(directory: Path) -> Iterator[None]:
    """Hold a run, which is made if need be and taken away again if it stays empty.

    A thread may hold a run again that it holds. On taking hold, files that a killed process left
    half written are removed. Raises Busy at once when another process (or thread) holds it,
    StageFailed when the directory cannot be made or written.
    """
    me = (os.path.realpath(directory), threading.get_ident())
    if me in _held:
        _held[me] += 1
        try:
            yield
        finally:
            _held[me] -= 1
        return
    made = _make(directory)
    try:
        handle = _take(directory)
        _held[me] = 1
        try:
            for path in directory.glob(".*.tmp"):
                path.unlink(missing_ok=True)
            yield
        finally:
            del _held[me]
            (directory / LOCK).unlink(missing_ok=True)  # while it is held: nobody else's
            os.close(handle)
    finally:
        for path in made:
            try:
                path.rmdir()
            except OSError:  # not empty: the work is in it
                break


def _make(directory: Path) -> list[Path]:
    """Make a directory; those that were not there, innermost first."""
    missing = [path for path in (directory, *directory.parents) if not path.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StageFailed(f"{directory}: cannot be made ({error.strerror}); give another --run")
    return missing


def _take(directory: Path) -> int:
    """Return a locked handle on the lock file."""
    path = directory / LOCK
    while True:
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise StageFailed(
                f"{directory}: cannot be written ({error.strerror}); give another --run"
            )
        try:
            if not _lock(handle):
                holder = os.read(handle, 200).decode(errors="replace")
                raise Busy(
                    f"{directory}: {holder or 'another process'} is working on it; wait for it or "
                    "give another --run"
                )
            # Its last holder may have removed the file between our opening and locking it.
            if path.exists() and os.path.samestat(os.fstat(handle), path.stat()):
                _sign(handle)
                return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _sign(handle: int) -> None:
    """Leave word of who holds the lock; a full disk does not matter."""
    try:
        os.truncate(handle, 0)
        os.write(handle, f"process {os.getpid()} on {socket.gethostname()}".encode())
    except OSError:
        pass


def _lock(handle: int) -> bool:
    """Return whether the lock could be taken. The system releases it when the process ends."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
