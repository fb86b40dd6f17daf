"""Parallel transport: frames along a curve or through time that do not turn about their tangent."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial.transform import Rotation


def unrolled(
    clamp: np.ndarray, curve: np.ndarray, clips: list[np.ndarray]
) -> tuple[np.ndarray, float]:
    """Return clamps (F, 2, 4) with the tangents of clamp (F, 2, 4), of rolls that are not seen, and
    by how much [rad] the far one would be turned about its tangent in a rope without twist.

    In a clip's first frame each is turned least from a direction fixed for all recordings, and from
    there on transported. The angle is the mean over the clips, by transport along curve (F, K, 3).
    """
    out, tangent, twists = np.full_like(clamp, np.nan), third(clamp), []
    usual = [_nearest_axis(np.nanmean(tangent[:, end], axis=0)) for end in range(2)]
    for clip in clips:
        seen = clip[np.isfinite(tangent[clip]).all(axis=(1, 2))]
        if not len(seen):
            continue
        for end, (frame, axis) in enumerate(usual):
            first = along(frame, np.array([axis, tangent[seen[0], end]]))[-1]
            out[seen, end] = along(first, tangent[seen, end])
        near, far = out[seen[0]]
        edges = np.diff(curve[seen[0]], axis=0)[1:-1]
        flat = along(near, np.array([tangent[seen[0], 0], *edges, tangent[seen[0], 1]]))[-1]
        # conj(far) flat is a turn about e3: its scalar part and its third.
        scalar, turn = far @ flat, far[0] * flat[3] - far[3] * flat[0] + far[2] * flat[1]
        twists.append(2 * np.arctan2(turn - far[1] * flat[2], scalar))
    return out, float(np.angle(np.nansum(np.exp(1j * np.array(twists)))))


def _nearest_axis(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a frame (4,) whose third axis is the coordinate axis, or its opposite, that is nearest
    to a direction (3,), and that axis (3,)."""
    k = int(np.argmax(np.abs(direction)))
    axes = np.roll(np.eye(3), 2 - k, axis=0)  # e_k is the last of the three
    axes[1:] *= np.sign(direction[k])
    return Rotation.from_matrix(axes.T).as_quat()[[3, 0, 1, 2]], axes[2]


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
