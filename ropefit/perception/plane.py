"""The vertical plane through both ends, onto which the paper projects its clouds."""

from __future__ import annotations

import numpy as np


def hanging_plane(
    ends: np.ndarray, gravity: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (origin (3,), unit normal (3,)) of the plane that holds gravity and both ends (2, 3).

    Where the ends lie above each other (or one is unknown), the plane takes the horizontal
    direction in which the points (N, 3) spread most.
    """
    size = np.linalg.norm(gravity)
    known = np.isfinite(ends).all(axis=1)
    origin = ends[np.argmax(known)] if known.any() else points.mean(axis=0)
    spread = points - origin
    if size == 0:
        return origin, np.linalg.svd(spread, full_matrices=False)[2][-1]
    down = gravity / size
    chord = ends[1] - ends[0] if known.all() else np.zeros(3)
    flat = chord - (chord @ down) * down
    extent = np.linalg.norm(spread, axis=1).max()
    if np.linalg.norm(flat) < 0.02 * max(extent, 1e-9):
        level = spread - (spread @ down)[:, None] * down
        flat = np.linalg.svd(level, full_matrices=False)[2][0]
        flat = flat - (flat @ down) * down
    if np.linalg.norm(flat) < 1e-12:
        flat = np.cross(down, np.eye(3)[int(np.argmin(np.abs(down)))])
    normal = np.cross(flat, down)
    return origin, normal / np.linalg.norm(normal)
