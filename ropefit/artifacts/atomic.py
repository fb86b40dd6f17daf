"""Files and folders that are whole or not there, whenever the process is killed."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ropefit.errors import StageFailed


def write_bytes(path: Path, *parts: bytes) -> None:
    """Write parts of a file, one after the other, beside it, flush, and rename. Raises OSError; the
    old file is then unchanged."""
    with writing(path) as out:
        out.writelines(parts)


@contextmanager
def writing(path: Path, room: int = 0) -> Iterator[BinaryIO]:
    """Give a file beside `path` to write, which is flushed and takes its place if nothing fails.
    Raises OSError, at once where there is no room for so many bytes; the old file is then
    unchanged."""
    if room > shutil.disk_usage(path.parent).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, "w+b") as out:
            yield out
            out.flush()
            os.fsync(out.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """Give a temporary folder to fill, which becomes `out` if nothing fails.

    Raises StageFailed where `out` has something in it or nothing can be written.
    """
    refuse_filled(out)
    temporary = None
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
        yield temporary
        os.chmod(temporary, 0o755)
        os.replace(temporary, out)
    except OSError as error:
        raise StageFailed(f"cannot write {out}: {error.strerror or error}")
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def refuse_filled(out: Path) -> None:
    """Raise StageFailed where `out` is a file, or a folder with something in it."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise StageFailed(f"{out}: exists already; give a new directory as --out")
