"""Markers that jump: a wrong label, a reflection. Such points are masked."""

from __future__ import annotations

import numpy as np

from ropefit.gaps import unbroken
from ropefit.perception.out_of_line import JUMP, out_of_line

ORDINARY_STEPS = 0.75  # of all are smaller than a jump, where frames are dense enough to tell one


def jumps(positions: np.ndarray, time: np.ndarray | None = None) -> np.ndarray:
    """Return (F, M) sizes [m] of jumps of markers (F, M, 3) [m], NaN where unseen; 0 of no jump.

    time (F,) [s], if frames have times: nothing jumps across a gap between two clips.

    A point is compared with where its marker was last seen, carried on as its neighbours along the
    rope moved since. Of both directions of time, that which masks fewer points of a marker in a
    clip counts: the first frame may be the wrong one. In frames too far apart for that (poses one
    after the other) it is compared with its neighbours along the rope (`out_of_line`).
    """
    size = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    size = size[np.isfinite(size)]
    if len(positions) < 3 or not size.size or np.quantile(size, ORDINARY_STEPS) > JUMP:
        return out_of_line(positions)
    if positions.shape[1] < 3:
        return np.zeros(positions.shape[:2])
    parts = [np.arange(len(positions))]
    if time is not None and np.isfinite(time).all():
        parts = unbroken(time)
    return np.concatenate([_either_way(positions[part]) for part in parts])


def _either_way(positions: np.ndarray) -> np.ndarray:
    """Return (F, M) sizes [m] of jumps in one clip, by that direction of time."""
    forward = _followed(positions)
    backward = _followed(positions[::-1])[::-1]
    jumped = np.where(forward.sum(axis=0) <= backward.sum(axis=0), forward, backward)
    good = np.isfinite(positions).all(axis=2) & ~jumped
    sizes = np.zeros(jumped.shape)
    for t, marker in np.argwhere(jumped):
        rows = np.flatnonzero(good[:, marker])
        if rows.size:
            near = rows[np.argmin(np.abs(rows - t))]
            sizes[t, marker] = np.linalg.norm(positions[t, marker] - positions[near, marker])
        else:
            sizes[t, marker] = JUMP
    return sizes


def _followed(positions: np.ndarray) -> np.ndarray:
    """Return (F, M) bool: points that are not where their marker can have moved."""
    count = positions.shape[1]
    good = np.asarray(np.isfinite(positions).all(axis=2))
    jumped = np.zeros_like(good)
    last = np.full(count, -1)  # the frame in which each marker was last where it can be
    for t in range(len(positions)):
        while True:
            excess = np.array([_excess(positions, good, t, m, last[m]) for m in range(count)])
            worst = int(np.argmax(excess))
            if excess[worst] <= JUMP:
                break
            good[t, worst], jumped[t, worst] = False, True
        last[good[t]] = t
    return jumped


def _excess(positions: np.ndarray, good: np.ndarray, t: int, marker: int, since: int) -> float:
    """Return how far [m] a marker moved since a frame, less the motion of its neighbours.

    Of one neighbour, or of two carried on to its place: whichever explains it best, so that a
    neighbour that jumps itself does no harm.
    """
    if since < 0 or not good[t, marker]:
        return 0.0
    moved = positions[t] - positions[since]
    others = np.flatnonzero(good[t] & good[since])
    left, right = others[others < marker][::-1][:2], others[others > marker][:2]
    expected = [moved[other] for other in (*left, *right)]
    expected += [2 * moved[side[0]] - moved[side[1]] for side in (left, right) if len(side) == 2]
    if len(left) and len(right):
        expected.append((moved[left[0]] + moved[right[0]]) / 2)
    if not expected:
        return 0.0
    return float(np.linalg.norm(moved[marker] - np.array(expected), axis=1).min())
