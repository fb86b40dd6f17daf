"""Many arrays of any type as one row of bytes, and back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np

AT_ONCE = 1 << 20  # bytes


class Stored(Protocol):
    """An array that is not in memory."""

    @property
    def dtype(self) -> np.dtype: ...

    @property
    def shape(self) -> tuple[int, ...]: ...

    @property
    def nbytes(self) -> int: ...

    def load(self) -> np.ndarray:
        """Return the array. Raises OSError."""
        ...


class Pieces:
    """Arrays that are one row of bytes in a file, and never in memory: one after the other."""

    dtype = np.dtype(np.uint8)

    def __init__(self, arrays: list[np.ndarray | Stored]):
        self.arrays = arrays
        self.nbytes = sum(one.nbytes for one in arrays)
        self.shape = (self.nbytes,)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.concatenate([np.empty(0, np.uint8), *self])

    def __iter__(self) -> Iterator[np.ndarray]:
        few: list[np.ndarray] = []  # that are written at once: each write takes its time
        size = 0
        for one in self.arrays:
            value = one if isinstance(one, np.ndarray) else one.load()
            if value.size:
                few.append(np.ascontiguousarray(value).reshape(-1).view(np.uint8))
                size += value.nbytes
            if size > AT_ONCE:
                yield np.concatenate(few)
                few, size = [], 0
        if few:
            yield np.concatenate(few)


Results = Mapping[str, Mapping[str, np.ndarray | Stored]]  # {result: {name: array}}
KINDS = "biufU"


def packed(results: Results) -> tuple[list[dict[str, Any]], Pieces]:
    """Return (what lies where, the bytes)."""
    arrays, parts, start = [], [], 0
    for result, found in results.items():
        for name, value in found.items():
            arrays.append({
                "result": result, "name": name, "dtype": value.dtype.str,
                "shape": list(value.shape), "start": start,
            })  # fmt: skip
            parts.append(value)
            start += value.nbytes
    return arrays, Pieces(parts)


def unpacked(arrays: Iterable[Any], data: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Return the results again. Raises ValueError for arrays that are not in the data."""
    results: dict[str, dict[str, np.ndarray]] = {}
    for a in arrays:
        kind = np.dtype(a.dtype)
        count = int(np.prod(a.shape, dtype=np.int64))
        if kind.kind not in KINDS or not 0 <= a.start <= len(data) - count * kind.itemsize:
            raise ValueError(f"{a.result}: {a.name} is not in the data")
        value = np.frombuffer(data, kind, count, a.start) if count else np.empty(0, kind)
        results.setdefault(a.result, {})[a.name] = value.reshape(a.shape).copy()
    return results
