"""One colour picture without depth: the rope in it, projected onto a plane that is assumed."""

from __future__ import annotations

import numpy as np

from ropefit.perception.camera import Camera
from ropefit.perception.follow import even
from ropefit.perception.plane import hanging_plane
from ropefit.perception.rgbd import check_near, check_tips, quality
from ropefit.perception.segment import Looked, Segmentation, segment_rope
from ropefit.perception.trace import FrameRejected, Trace, polyline_arc

UNKNOWN_DEPTH = 1.0  # m: without a length and without ends the scale is anybody's guess
FLATTEST = 0.25  # sine of the angle between ray and plane below which a plane is seen edge on


def trace_image(
    color: np.ndarray,
    camera: Camera,
    ends: np.ndarray,
    length: float | None,
    gravity: np.ndarray,
    looked: Looked | None = None,
) -> tuple[Trace, Segmentation]:
    """Trace a rope in colour (H, W, 3) alone. ends (2, 3) [m], NaN where unknown.

    The pixels are what is measured. The points are their projection onto the plane of gravity and
    both ends, where both are known and the plane is not seen edge on; else onto one that faces the
    camera, as far away as makes the rope as long as it is. Raises FrameRejected.
    """
    known = np.asarray(np.isfinite(ends).all(axis=1))
    tips = np.full((2, 2), np.nan)
    tips[known] = camera.project(ends[known])
    check_tips(tips, color.shape[:2])
    found = segment_rope(color, tips, None, looked)
    check_near(found, tips)
    pixels = even(found.path, 1.0)
    seen = np.interp(polyline_arc(pixels), polyline_arc(found.path), found.seen.astype(float)) > 0.5
    if seen.sum() < 4:
        raise FrameRejected("the rope is visible along too little of its expected path")
    line = projected(pixels, camera, ends, length, gravity)
    arc = polyline_arc(line)
    scale = length / arc[-1] if length and known.all() else 1.0
    total = length if length and known.all() else float(arc[-1])
    trace = Trace(
        points=line[seen],
        point_arc=arc[seen] * scale,
        centreline=line,
        arc=arc * scale,
        length=total,
        reach=total / 60,
        pixels=pixels[seen],
        pixel_arc=arc[seen] * scale,
        quality=quality(found, seen),
        traced=float(arc[-1]),
    )
    return trace, found


def projected(
    pixels: np.ndarray,
    camera: Camera,
    ends: np.ndarray,
    length: float | None,
    gravity: np.ndarray,
) -> np.ndarray:
    """Return (P, 3) [m] pixels (P, 2) of a rope projected onto the plane that it should lie in."""
    known = np.isfinite(ends).all(axis=1)
    rays = camera.rays(pixels)
    eye, ahead = camera.pose[:3, 3], camera.pose[:3, 2]
    if known.all():
        origin, normal = hanging_plane(ends, gravity, ends)
        if np.abs(rays @ normal).min() > FLATTEST:
            distance = ((origin - eye) @ normal) / (rays @ normal)
            if (distance > 0).all():
                return eye + distance[:, None] * rays
    if known.any():
        depth = float(np.mean((ends[known] - eye) @ ahead))
    elif length:
        flat = camera.unproject(pixels, np.ones(len(pixels)))
        depth = length / float(polyline_arc(flat)[-1])
    else:
        depth = UNKNOWN_DEPTH
    if depth <= 0:
        raise FrameRejected("the ends lie behind the camera: camera_pose or ends are wrong")
    return camera.unproject(pixels, np.full(len(pixels), depth))
