"""Markers off a rope's axis: their offsets turn with the rope's material frame."""

from __future__ import annotations

import numpy as np

from ropefit.rod.quaternion import rotate


def off_axis(offset: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (F, N+1, 3) [m] the offsets (N+1, 2) [m] of markers at the nodes in space, along the
    first two directors of the segments' frames q (F, N, 4); at an inner node the mean of those of
    both segments."""
    return _at_nodes(*(rotate(q, side) for side in _sides(offset)))


def off_axis_turned(offset: np.ndarray, q: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return (F, P, N+1, 3) [m] changes of the same by turns (F, P, N, 3) [rad] of the frames about
    their own directors."""
    return _at_nodes(*(rotate(q[:, None], np.cross(turn, side)) for side in _sides(offset)))


def _sides(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (N, 3), (N, 3) the offsets of each segment's two nodes in its own frame."""
    own = np.pad(offset, ((0, 0), (0, 1)))
    return own[:-1], own[1:]


def _at_nodes(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return (..., N+1, 3) the means of what the segments (..., N, 3) that meet at a node have
    there: at their first node and at their second."""
    out = np.empty((*before.shape[:-2], before.shape[-2] + 1, 3))
    out[..., 0, :], out[..., -1, :] = before[..., 0, :], after[..., -1, :]
    out[..., 1:-1, :] = 0.5 * (before[..., 1:, :] + after[..., :-1, :])
    return out
