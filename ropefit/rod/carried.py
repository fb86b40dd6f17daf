"""Parallel transport: frames along a curve or through time that do not turn about their tangent."""

from __future__ import annotations

import itertools

import numpy as np


def carried(clamp: np.ndarray, curve: np.ndarray, clips: list[np.ndarray]) -> np.ndarray:
    """Return clamps (F, 2, 4) with the tangents of clamp (F, 2, 4), transported through each clip.

    In a clip's first frame the far clamp is the near one, transported along curve (F, K, 3).
    """
    out = clamp.copy()
    tangent = third(clamp)
    for clip in clips:
        t0, edges = clip[0], np.diff(curve[clip[0]], axis=0)
        way = [tangent[t0, 0], *edges[1:-1], tangent[t0, 1]]
        out[t0, 1] = along(out[t0, 0], np.array(way))[-1]
        for end in range(2):
            out[clip, end] = along(out[t0, end], tangent[clip, end])
    return out


def along(q: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Return (K, 4) the frame q (4,) at the first of tangents (K, 3), by parallel transport."""
    unit = tangents / np.linalg.norm(tangents, axis=-1, keepdims=True)
    out = [q]
    for a, b in itertools.pairwise(unit):
        w, v = 1 + a @ b, np.cross(a, b)
        p, u = out[-1][0], out[-1][1:]
        turned = np.r_[w * p - v @ u, w * u + p * v + np.cross(v, u)]
        out.append(turned / np.linalg.norm(turned))
    return np.array(out)


def third(q: np.ndarray) -> np.ndarray:
    """Return (..., 3) the tangents R(q) e3."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)


def continuous(q: np.ndarray) -> np.ndarray:
    """Return (F, ..., 4) the same rotations, of their two quaternions the nearer to the last."""
    out = q.copy()
    for t in range(1, len(out)):
        against = np.nan_to_num((out[t] * out[t - 1]).sum(-1, keepdims=True)) < 0
        out[t] = np.where(against, -out[t], out[t])
    return out
