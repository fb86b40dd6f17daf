"""How much a path through a mask is like a rope, between 0 and 1."""

from __future__ import annotations

import cv2
import numpy as np

from ropefit.perception.follow import even
from ropefit.perception.linking import Path
from ropefit.perception.strands import Strands

ROPE_ASPECT = 40.0  # widths: a path this long is half convincing by its length
PLAIN = 10.0  # distance in Lab: a contrast that is half convincing
PIECES = 15  # a path put together from this many is half convincing
BENT = 0.15  # rad per width of path: a rope that bends this much all along is half convincing


def ropiness(
    mask: np.ndarray, strands: Strands, path: Path, lab: np.ndarray, ends: np.ndarray
) -> float:
    """Return 0..1: how much a path through a mask is like a rope: long for its width, even in
    width, plainly another colour than beside it, smooth, and most of what is in the mask."""
    width = strands.width
    on = path.points[path.seen]
    columns, rows = np.clip(np.round(on).astype(int), 0, [mask.shape[1] - 1, mask.shape[0] - 1]).T
    radius = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)[rows, columns]
    long = path.length / (path.length + ROPE_ASPECT * width)
    usual = float(np.median(radius)) + 1e-6
    even_ = usual / (usual + float(np.abs(radius - usual).mean()))
    tidy = min(len(on) * width / max(np.count_nonzero(mask), 1), 1.0)
    contrast = _contrast(path, lab, width)
    plain = contrast / (contrast + PLAIN)
    turning = _turning(path.points, width)
    smooth = 1 / (1 + turning / BENT)
    near = 1.0
    for end, tip in zip(ends, on[[0, -1]], strict=True):
        if np.isfinite(end).all():
            near *= float(np.exp(-np.linalg.norm(end - tip) / (0.15 * np.hypot(*mask.shape))))
    whole = 1 / (1 + path.bridged / PIECES)
    return float(long * even_**2 * tidy * plain * smooth * near * whole)


def _turning(points: np.ndarray, width: float) -> float:
    """Return mean turn of a path [rad] per width of path."""
    line = even(points, max(width, 2.0))
    step = np.diff(line, axis=0)
    if len(step) < 3:
        return np.pi
    angle = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    return float(np.abs(np.diff(angle)).mean())


def _contrast(path: Path, lab: np.ndarray, width: float) -> float:
    """Return colour distance [Lab] between the path and both sides of it, less what the sides
    differ.

    The seam where rope and ground mix is thin and long too, but its two sides are not alike.
    """
    on = path.points[path.seen]
    tangent = np.gradient(on, axis=0) if len(on) > 1 else np.zeros_like(on)
    side = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    far = 1.5 * width + 2

    def at(points: np.ndarray) -> np.ndarray:
        p = points.astype(np.float32)[:, None]
        border = cv2.BORDER_REPLICATE
        return cv2.remap(lab, p[..., 0], p[..., 1], cv2.INTER_LINEAR, borderMode=border)[:, 0]

    here, left, right = at(on), at(on + far * side), at(on - far * side)
    least = np.minimum(np.linalg.norm(here - left, axis=1), np.linalg.norm(here - right, axis=1))
    return max(float(np.median(least - 0.5 * np.linalg.norm(left - right, axis=1))), 0.0)
