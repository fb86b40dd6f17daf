"""Many arrays of any type as one row of bytes, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

Results = Mapping[str, Mapping[str, np.ndarray]]  # {result: {name: array}}
KINDS = "biufU"


def packed(results: Results) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Return (what lies where, bytes (n,) uint8)."""
    arrays, parts, start = [], [], 0
    for result, found in results.items():
        for name, value in found.items():
            value = np.asarray(value, order="C")
            arrays.append({
                "result": result, "name": name, "dtype": value.dtype.str,
                "shape": list(value.shape), "start": start,
            })  # fmt: skip
            parts.append(value.reshape(-1).view(np.uint8) if value.size else np.empty(0, np.uint8))
            start += value.nbytes
    return arrays, np.concatenate(parts) if parts else np.empty(0, np.uint8)


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
