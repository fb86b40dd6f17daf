"""What else is in a cloud: tables and walls, and whatever the rope cannot reach."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

TRIES = 200  # planes through three points that are tried
LEAST_SHARE = 0.15  # of the points: fewer in a plane are no table
MOST_PLANES = 3
TABLE_THICKNESS = 0.01  # of the size of the rope: first guess of a table's thickness
SPREAD = 3.5  # robust sd of a table's points to each side that are taken for it
FLAT = 0.35  # second over first variance of points around a point: a sheet has 1, a rope little
ROUND = 0.02  # of the size of the rope: the neighbourhood in which that is looked at
SLACK = 1.1  # times the rope's length: farther than that from both ends together it cannot be


def foreground(points: np.ndarray, ends: np.ndarray, length: float | None) -> np.ndarray:
    """Return (M, 3) [m] the points (N, 3) that may be rope: no sheet, within reach of known ends
    (2, 3).

    A rope that hangs in a plane stays: its points are no sheet there but a line.
    """
    known = np.asarray(np.isfinite(ends).all(axis=1))
    if length and len(points):
        away = np.linalg.norm(points[:, None] - ends[known][None], axis=2)
        if known.all():
            points = points[away.sum(axis=1) < SLACK * length]
        elif known.any():
            points = points[away[:, 0] < SLACK * length]
    rng = np.random.default_rng(0)
    for _ in range(MOST_PLANES):
        if len(points) < 50:
            break
        size = length or float(np.linalg.norm(np.diff(np.quantile(points, (0.05, 0.95), axis=0))))
        inside = sheet(points, size, rng)
        if inside is None:
            break
        points = points[~inside]
    return points


def sheet(
    points: np.ndarray, size: float, rng: np.random.Generator, least: float = LEAST_SHARE
) -> np.ndarray | None:
    """Return (N,) bool: the points of the plane that holds the most, if they are a sheet.

    size [m]: of the rope; least: share of the points.
    """
    some = points[rng.choice(len(points), min(len(points), 2000), replace=False)]
    corners = some[rng.integers(0, len(some), (TRIES, 3))]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    heights = np.abs(some @ normal.T - (corners[:, 0] * normal).sum(axis=1))
    best = int((heights < TABLE_THICKNESS * size).sum(axis=0).argmax())
    inside = np.abs((points - corners[best, 0]) @ normal[best]) < TABLE_THICKNESS * size
    for _ in range(3):
        if inside.sum() < max(least * len(points), 30):
            return None
        middle = points[inside].mean(axis=0)
        axis = np.linalg.eigh(np.cov((points[inside] - middle).T))[1][:, 0]
        height = (points - middle) @ axis
        sd = 1.4826 * np.median(np.abs(height[inside])) + 1e-9
        inside = np.abs(height) < min(max(SPREAD * sd, 1e-4 * size), 2 * TABLE_THICKNESS * size)
    return inside if _is_sheet(points[inside], size, rng) else None


def _is_sheet(points: np.ndarray, size: float, rng: np.random.Generator) -> bool:
    """Return whether points (N, 3) spread to two sides around most of them."""
    tree = KDTree(points)
    ratios = []
    for at in points[rng.choice(len(points), min(len(points), 60), replace=False)]:
        near = points[tree.query_ball_point(at, ROUND * size)]
        if len(near) < 4:
            continue
        variance = np.linalg.eigvalsh(np.cov((near - near.mean(axis=0)).T))
        # A clump much smaller than the neighbourhood is no piece of a sheet.
        fills = variance[2] > (0.2 * ROUND * size) ** 2
        ratios.append(float(variance[1] / variance[2]) if fills else 0.0)
    return len(ratios) > 0 and float(np.median(ratios)) > FLAT
