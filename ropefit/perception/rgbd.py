"""One RGB-D frame: mask, skeleton, back-projection, arc length."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, median_filter

from ropefit.perception.camera import Camera
from ropefit.perception.segment import Segmentation, segment_rope
from ropefit.perception.trace import FrameRejected, Trace, polyline_arc, project_to_polyline

LEAST_DEPTHS = 20
STRETCH = 8  # px along the path, to each side
AGREE = 0.02  # of the depth: a rope does not recede faster along such a stretch


def trace_rgbd(
    color: np.ndarray,
    depth: np.ndarray,
    camera: Camera,
    ends: np.ndarray,
    length: float | None,
    radius: float | None,
) -> tuple[Trace, Segmentation]:
    """Trace a rope in colour (H, W, 3) and depth (H, W) [m], 0 = none.

    ends (2, 3) [m], NaN where unknown. Each skeleton pixel takes the median depth of the mask
    around
    it; `radius` [m] moves the visible front of the rope back to its axis. Raises FrameRejected.
    """
    known = np.asarray(np.isfinite(ends).all(axis=1))
    tips = np.full((2, 2), np.nan)
    tips[known] = camera.project(ends[known])
    found = segment_rope(color, tips)
    at = _depth_along(found, depth)
    good = at > 0
    if good.sum() < LEAST_DEPTHS:
        raise FrameRejected(f"depth at {int(good.sum())} of {len(at)} skeleton pixels")
    good &= ~_flying(at, good)
    pixels = found.path[good]
    points = camera.unproject(pixels, at[good]) + (radius or 0.0) * camera.rays(pixels)

    # Centreline: smooth over about two rope widths of path, in space, then through the known ends.
    line = gaussian_filter1d(points, max(found.width, 4.0), axis=0, mode="nearest")
    line = _untangle(line)
    if known[0]:
        line = np.vstack([ends[0], line])
    if known[1]:
        line = np.vstack([line, ends[1]])
    arc = polyline_arc(line)
    scale = length / arc[-1] if length and known.all() else 1.0
    total = length if length and known.all() else float(arc[-1])
    place, _ = project_to_polyline(points, line)
    point_arc = np.interp(place, np.arange(len(line)), arc) * scale
    path_arc = np.interp(np.arange(len(found.path)), np.flatnonzero(good), point_arc)
    trace = Trace(
        points=points,
        point_arc=point_arc,
        centreline=line,
        arc=arc * scale,
        length=total,
        reach=total / 60,
        pixels=found.path,
        pixel_arc=path_arc,
    )
    return trace, found


def _depth_along(found: Segmentation, depth: np.ndarray, window: int = 2) -> np.ndarray:
    """(P,) [m] depth of the rope at each path pixel; 0 where there is none.

    At the rope's edge a depth pixel belongs to the background or lies between (flying pixels),
    always
    behind the rope. So the nearest quarter of the mask's depths along a stretch of path says where
    the rope is, and each pixel takes the median of those around it that agree.
    """
    rows = np.round(found.path[:, 1]).astype(int)
    columns = np.round(found.path[:, 0]).astype(int)
    patches = []
    for row, column in zip(rows, columns, strict=True):
        patch = (
            slice(max(row - window, 0), row + window + 1),
            slice(max(column - window, 0), column + window + 1),
        )
        patches.append(depth[patch][found.mask[patch] & (depth[patch] > 0)])
    out = np.zeros(len(rows))
    for i in range(len(rows)):
        stretch = np.concatenate(patches[max(i - STRETCH, 0) : i + STRETCH + 1])
        if stretch.size == 0:
            continue
        front = np.percentile(stretch, 25)
        agree = patches[i][np.abs(patches[i] - front) < AGREE * front]
        out[i] = np.median(agree) if agree.size else 0.0
    return out


def _flying(depth: np.ndarray, good: np.ndarray, width: int = 31) -> np.ndarray:
    """(P,) bool: depths far from the running median along the path (background seen at the
    edge)."""
    smooth = np.zeros_like(depth)
    smooth[good] = median_filter(depth[good], size=min(width, int(good.sum())), mode="nearest")
    gap = np.abs(depth - smooth)
    usual = 1.4826 * np.median(gap[good])
    return good & (gap > max(5 * usual, 0.005))


def _untangle(line: np.ndarray) -> np.ndarray:
    """Points of the line that advance: steps back along it (noise in depth) are left out."""
    keep = [0]
    ahead = gaussian_filter1d(line, 8, axis=0, mode="nearest")
    direction = np.gradient(ahead, axis=0)
    for i in range(1, len(line)):
        if (line[i] - line[keep[-1]]) @ direction[i] > 0:
            keep.append(i)
    return line[keep]
