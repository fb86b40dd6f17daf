"""What one frame of any sensor becomes: ordered points along the rope and a denoised centreline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CHUNK = 64  # edges of a polyline that all points are compared with at once


class FrameRejected(Exception):
    """A frame that cannot be used; its text is the reason a person reads."""


@dataclass(frozen=True)
class Trace:
    """One frame. Arc lengths run from 0 at end 0 to `length` [m] at end 1, as far as they are
    known.

    points (N, 3) [m] ordered by point_arc (N,); centreline (M, 3) with arc (M,), denoised and
    dense;
    pixels (P, 2) with pixel_arc (P,), or None when there is no image; reach [m]: how far along the
    rope a point speaks for its neighbourhood (its sampling distance); quality 0..1: how far the
    frame is to be trusted; traced [m]: length of the line as traced, before `length` scaled it;
    before (N,) [m]: how far the points were moved onto the axis from the visible surface.
    """

    points: np.ndarray
    point_arc: np.ndarray
    centreline: np.ndarray
    arc: np.ndarray
    length: float
    reach: float
    pixels: np.ndarray | None = None
    pixel_arc: np.ndarray | None = None
    quality: float = 1.0
    traced: float | None = None
    before: np.ndarray | None = None


def polyline_arc(points: np.ndarray) -> np.ndarray:
    """Return (N,) cumulative length along points (N, D)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def resample(points: np.ndarray, arc: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return (M, D) points of a polyline (N, D) with increasing arc (N,) at places (M,), linear
    between."""
    return np.stack([np.interp(at, arc, column) for column in points.T], axis=1)


def project_to_polyline(points: np.ndarray, line: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for points (N, D), the fractional index (N,) on the polyline (M, D) and offset
    vectors (N, D)."""
    start, edge = line[:-1], np.diff(line, axis=0)
    square = np.maximum((edge**2).sum(axis=1), 1e-300)
    best = np.full(len(points), np.inf)
    place = np.zeros(len(points))
    offset = np.zeros_like(points)
    for first in range(0, len(edge), CHUNK):
        part = slice(first, first + CHUNK)
        gap = points[:, None] - start[part]
        along = np.clip((gap * edge[part]).sum(axis=2) / square[part], 0, 1)
        gap -= along[..., None] * edge[part]
        distance = (gap**2).sum(axis=2)
        k = distance.argmin(axis=1)
        rows = np.arange(len(points))
        nearest = distance[rows, k]
        closer = nearest < best
        best[closer] = nearest[closer]
        place[closer] = (first + k + along[rows, k])[closer]
        offset[closer] = gap[rows, k][closer]
    return place, offset
