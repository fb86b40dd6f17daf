"""Frames turned about their own axes: gradients in such turns, and back; ropes that are rolled."""

from __future__ import annotations

import numpy as np


def to_turn(q: np.ndarray, gradient: np.ndarray, factor: float) -> np.ndarray:
    """Return factor Im(q* g) (..., 3) of quaternions q and g (..., 4).

    With 1/2, the gradient in a turn δ of q <- q exp(δ/2) from the gradient in q; with 2, the turn
    from a change of q.
    """
    w, v = q[..., :1], q[..., 1:]
    g, h = gradient[..., :1], gradient[..., 1:]
    return factor * (w * h - g * v - np.cross(v, h))


def from_turn(q: np.ndarray, turn: np.ndarray, factor: float) -> np.ndarray:
    """Return factor q (0, turn) (..., 4).

    With 2, the gradient in q (of unit length) from that in a turn; with 1/2, the change of q by a
    turn.
    """
    w, v = q[..., :1], q[..., 1:]
    real = -(v * turn).sum(-1, keepdims=True)
    return factor * np.concatenate([real, w * turn + np.cross(v, turn)], axis=-1)


def rolled(q: np.ndarray, bent: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Return (F, N, 4) frames rolled about their own tangents, all of a rope alike.

    Until its bends (F, M, 2) lie, on the whole, as `toward` (F, M, 2) does.
    """
    along = (bent * toward).sum((1, 2))
    across = (bent[..., 1] * toward[..., 0] - bent[..., 0] * toward[..., 1]).sum(1)
    half = 0.5 * np.arctan2(across, along)[:, None]
    c, s = np.cos(half), np.sin(half)
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack([w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s], axis=-1)
