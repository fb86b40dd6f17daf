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


def off_axis_turned(offset: np.ndarray, q: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return (F, P, N+1, 3) [m] changes of the same by turns (F, P, N, 3) [rad] of the frames q (F,
    N, 4) about their own directors."""
    rows = rotate(q[..., None, :], np.eye(3)).swapaxes(-1, -2)
    own = np.pad(offset, ((0, 0), (0, 1)))
    # R (turn x offset) at both nodes of each segment as one matrix product: P is large.
    maps = (np.cross(side[:, None], rows).swapaxes(-1, -2) for side in (own[:-1], own[1:]))
    turned = turn.swapaxes(1, 2)
    return _at_nodes(*((turned @ one).swapaxes(1, 2) for one in maps))


def _at_nodes(before: np.ndarray, after: np.ndarray | None = None) -> np.ndarray:
    """Return (..., N+1, 3) the means of what the segments (..., N, 3) that meet at a node have
    there: at their first node, and at their second if it differs."""
    after = before if after is None else after
    out = np.empty((*before.shape[:-2], before.shape[-2] + 1, 3))
    out[..., 0, :], out[..., -1, :] = before[..., 0, :], after[..., -1, :]
    out[..., 1:-1, :] = 0.5 * (before[..., 1:, :] + after[..., :-1, :])
    return out
