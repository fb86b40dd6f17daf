"""Frames that follow each other in time, and where they do not."""

from __future__ import annotations

import numpy as np

LONGEST_GAP = 3.0  # median steps: nothing is followed across more


def unbroken(time: np.ndarray, longest: float = np.inf) -> list[np.ndarray]:
    """Return indices of the frames that follow each other without a gap, in order.

    time (F,) [s]; longest [s]: that no step exceeds, even if most do not.
    """
    steps = np.diff(time)
    gap = min(longest, LONGEST_GAP * float(np.median(steps))) if len(steps) else longest
    return np.split(np.arange(len(time)), np.flatnonzero((steps > gap) | (steps <= 0)) + 1)
