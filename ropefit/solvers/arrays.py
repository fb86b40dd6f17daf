"""Arrays as compiled code takes them, and its work spread over threads."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
from torch import Tensor


def as_numpy(t: Tensor) -> np.ndarray:
    """Return a tensor as a contiguous float64 array; a view where it is one already."""
    return np.ascontiguousarray(t.detach().numpy(), dtype=np.float64)


def in_threads(work: Callable[[slice], None], frames: int, fewest: int = 8) -> None:
    """Call `work` on slices of the frames, one for each of torch's threads, if it has at least the
    `fewest` frames that are worth a thread."""
    pieces = min(torch.get_num_threads(), frames // fewest)
    if pieces <= 1:
        work(slice(0, frames))
        return
    bounds = [frames * k // pieces for k in range(pieces + 1)]
    with ThreadPoolExecutor(pieces) as pool:
        list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))
