"""Arrays as compiled code takes them, and its work spread over threads."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ropefit.rod.either import Array, plain
from ropefit.runs.threads import threads


def as_numpy(array: Array) -> np.ndarray:
    """Return an array or a tensor as a contiguous float64 array that may be written; a view where
    it is one already."""
    out = np.ascontiguousarray(plain(array), dtype=np.float64)
    return out if out.flags.writeable else out.copy()


def in_threads(work: Callable[[slice], None], frames: int, fewest: int = 8) -> None:
    """Call `work` on slices of the frames, one for each thread that there may be, if it has at
    least the `fewest` frames that are worth a thread."""
    pieces = min(threads(), frames // fewest)
    if pieces <= 1:
        work(slice(0, frames))
        return
    bounds = [frames * k // pieces for k in range(pieces + 1)]
    with ThreadPoolExecutor(pieces) as pool:
        list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))
