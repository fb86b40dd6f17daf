"""Markers off a rope's axis: their offsets turn with the rope's material frame."""

from __future__ import annotations

import numpy as np

from ropefit.rod.quaternion import rotate


def sides_at_nodes(q: np.ndarray) -> np.ndarray:
    """Return (F, 2, N+1, 3) the first two directors of the segments' frames q (F, N, 4); at an
    inner node the mean of those of both segments."""
    return _at_nodes(rotate(q[:, None], np.eye(3)[:2, None]))


def off_axis(offset: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Return (F, N+1, 3) [m] the offsets (N+1, 2) [m] of markers at the nodes in space, along the
    `sides_at_nodes` of the rope."""
    return offset[:, :1] * sides[:, 0] + offset[:, 1:] * sides[:, 1]


def off_axis_turned(
    offset: np.ndarray, q: np.ndarray, turn: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Return (F, P, K, 3) [m] changes of the same at some nodes (K,) by turns (F, P, N, 3) [rad] of
    the frames q (F, N, 4) about their own directors."""
    rows = rotate(q[..., None, :], np.eye(3)).swapaxes(-1, -2)
    own = 0.5 * np.pad(offset, ((0, 0), (0, 1)))[nodes, None]
    turned = turn.swapaxes(1, 2)
    out = np.zeros((len(q), len(nodes), turn.shape[1], 3))
    for segment in (np.maximum(nodes - 1, 0), np.minimum(nodes, turn.shape[2] - 1)):
        # R (turn x offset) as one matrix product: P is large.
        out += turned[:, segment] @ np.cross(own, rows[:, segment]).swapaxes(-1, -2)
    return out.swapaxes(1, 2)


def _at_nodes(ours: np.ndarray) -> np.ndarray:
    """Return (..., N+1, 3) the means of what the segments (..., N, 3) have that meet at a node."""
    out = np.empty((*ours.shape[:-2], ours.shape[-2] + 1, 3))
    out[..., 0, :], out[..., -1, :] = ours[..., 0, :], ours[..., -1, :]
    out[..., 1:-1, :] = 0.5 * (ours[..., 1:, :] + ours[..., :-1, :])
    return out
