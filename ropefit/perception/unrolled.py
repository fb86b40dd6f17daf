"""A picture unrolled along a path: where, to its sides, the edges of a rope show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter, minimum_filter1d, uniform_filter1d

ALONG = 4.0  # widths along the path over which evidence is gathered
EDGE = 0.12  # widths: blur of the edges that are looked for
SOLID = 15.0  # of colour in Lab: what an edge in depth counts as much as
ALIKE = 0.015  # of the depth: nearer to that of the path is the same thing


@dataclass(frozen=True)
class Strip:
    """A picture unrolled along a path: evidence (S, O) of a rope at stations and offsets [px]."""

    evidence: np.ndarray
    offsets: np.ndarray
    step: float


def normals(path: np.ndarray, smooth: float) -> np.ndarray:
    """Return (P, 2) unit normals of a path, of its direction over about `smooth` points."""
    tangent = np.gradient(gaussian_filter1d(path, smooth, axis=0, mode="nearest"), axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    return np.column_stack([-tangent[:, 1], tangent[:, 0]])


def edges(
    lab: np.ndarray,
    path: np.ndarray,
    width: float,
    reach: float,
    along: float = ALONG,
    depth: np.ndarray | None = None,
) -> Strip:
    """Return how strongly the colour of Lab (H, W, 3) changes across a path (S, 2) evenly spaced,
    at offsets of up to `reach` [px] and a width more, gathered over `along` widths of path. With
    depth (H, W) [m] also where things begin and end that are as far away as the path."""
    step = max(width / 8, 0.5)
    half = np.ceil((reach + 1.5 * width) / step)
    offsets = np.arange(-half, half + 1) * step
    spacing = float(np.linalg.norm(np.diff(path, axis=0), axis=1).mean())
    side = normals(path, max(width / spacing, 1.0))
    at = (path[:, None] + offsets[:, None] * side[:, None]).astype(np.float32)
    flat = cv2.remap(lab, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    flat = flat.reshape(len(path), len(offsets), -1)
    size = max(round(along * width / spacing), 1)
    blur = max(EDGE * width / step, 0.7)

    def slopes(values: np.ndarray) -> np.ndarray:
        smooth = uniform_filter1d(values, size, axis=0, mode="nearest")
        return gaussian_filter1d(smooth, blur, axis=1, order=1) * width / step

    evidence = np.linalg.norm(slopes(flat), axis=2)
    if depth is not None:
        solid = _as_far(depth, at, np.abs(offsets) <= width / 4)
        # A change of colour where the thing goes on is shading or a pattern, no edge of it.
        inside = uniform_filter1d(solid, size, axis=0, mode="nearest")
        inside = minimum_filter1d(inside, round(2 * blur) + 1, axis=1)
        evidence = np.hypot((1 - inside) * evidence, SOLID * slopes(solid))
    return Strip(evidence, offsets, step)


def _as_far(depth: np.ndarray, at: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return (S, O) 1 where depth (H, W) [m] at places (S, O, 2) [px] is that of the `middle` (O,)
    of the path, which is the nearest there: what lies beside a rope is behind it."""
    z = cv2.remap(depth.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_NEAREST)
    inner = np.sort(np.where(z[:, middle] > 0, z[:, middle], np.inf), axis=1)
    front = median_filter(inner[:, inner.shape[1] // 3], 9, mode="nearest")[:, None]
    with np.errstate(invalid="ignore"):
        return (np.abs(z - front) < ALIKE * z).astype(np.float32)


def unroll(
    lab: np.ndarray,
    path: np.ndarray,
    width: float,
    reach: float,
    along: float = ALONG,
    depth: np.ndarray | None = None,
) -> Strip:
    """Return evidence for a rope of `width` [px] along a path (S, 2) evenly spaced in Lab (H, W,
    3).

    Evidence is the weaker of two edges that are a width apart, gathered along the path: a rope has
    two even where it is as light as the ground, a shadow or a fold seldom has both.
    """
    strip = edges(lab, path, width, reach, along, depth)
    # Of a rope that is known to be there the product: where it lies, both edges say alike.
    return pairs(strip, width, reach, np.minimum if depth is None else _both)


def _both(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return np.sqrt(left * right)


def pairs(
    strip: Strip,
    width: float,
    reach: float,
    together: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.minimum,
) -> Strip:
    """Return, of a strip of edges, evidence `together` of the two that lie a width apart about each
    offset of up to `reach` [px]."""
    half = round(0.5 * width / strip.step)
    found = together(np.roll(strip.evidence, half, 1), np.roll(strip.evidence, -half, 1))
    inside = np.abs(strip.offsets) <= reach + 1e-9
    return Strip(found[:, inside], strip.offsets[inside], strip.step)
