"""Tables of numbers inside point-cloud files, with every size checked before anything is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput


def from_text(path: Path, body: bytes, count: int, columns: int, skip: int = 0) -> np.ndarray:
    """Return (count, columns) numbers separated by white space, after `skip` others."""
    most = skip + count * columns
    if most > len(body):  # a number takes at least one byte
        raise BadInput(f"{path}: truncated: declares {count} points, more than it can hold")
    words = body.split(None, most)[skip:most]
    if len(words) < most - skip:
        raise BadInput(f"{path}: truncated: {len(words) // columns} of {count} points readable")
    try:
        return np.fromiter(map(float, words), float, most - skip).reshape(count, columns)
    except ValueError as error:
        raise BadInput(f"{path}: a point is no number ({error})")


def from_records(
    path: Path, body: bytes, count: int, record: np.dtype, skip: int = 0
) -> np.ndarray:
    """Return (count,) records of fixed size, after `skip` bytes."""
    if skip + count * record.itemsize > len(body):
        have = max(len(body) - skip, 0) // max(record.itemsize, 1)
        raise BadInput(f"{path}: truncated: {have} of {count} points readable")
    return np.frombuffer(body, record, count, skip)


def number(path: Path, word: bytes, what: str, most: int = 2**40) -> int:
    """Return a count of a header: 0 to `most`."""
    if not word.isdigit() or len(word) > 15 or int(word) > most:
        raise BadInput(f"{path}: header says {what} {word[:20]!r}")
    return int(word)


def columns_of(records: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return (N, len(names)) float64 columns of structured records."""
    with np.errstate(all="ignore"):  # a signalling NaN becomes a quiet one
        return np.stack([records[name].astype(float) for name in names], axis=1)
