"""Order an unordered cloud of rope points: outliers out, geodesic order, centreline, arc length."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from ropefit.perception.background import foreground
from ropefit.perception.graph import bridge, neighbour_graph
from ropefit.perception.trace import (
    FrameRejected,
    Trace,
    polyline_arc,
    project_to_polyline,
    resample,
)
from ropefit.perception.whole_scene import is_scene, rope_in_scene

LEAST_POINTS = 20
BINS = 60  # along the rope, in which points are averaged
NEIGHBOURS = 8
LONELY = 1.6  # times the usual distance of the eighth neighbour
# A line between the held ends outside these shares of the rope's length took a wrong turn.
SHORTEST, LONGEST = 0.75, 1.3
BRANCH = 0.1  # share of the points, and of the way from end to end, that may be off that way


def remove_outliers(points: np.ndarray) -> np.ndarray:
    """Return (M, 3) [m] distinct points with neighbours about as near as usual.

    A point at the tip of the rope has its neighbours on one side only, half as many: it stays.
    """
    points = np.unique(points, axis=0)  # copies would be each other's neighbours
    if len(points) < LEAST_POINTS:
        return points
    away = np.asarray(KDTree(points).query(points, k=NEIGHBOURS + 1)[0])  # the first is the point
    return points[away[:, NEIGHBOURS // 4] < LONELY * np.median(away[:, -1])]


def trace_cloud(
    points: np.ndarray,
    ends: np.ndarray,
    length: float | None,
    radius: float | None = None,
    viewpoint: np.ndarray | None = None,
    most: int = 400,
) -> Trace:
    """Order the cloud (N, 3) [m] of one frame.

    ends (2, 3): known end positions, NaN where unknown (then the farthest point of the cloud is the
    end). With `radius` [m] and `viewpoint` (3,) the visible surface is moved back onto the
    centreline. At most `most` points are kept, evenly in order. Raises FrameRejected.
    """
    if is_scene(points, length):
        points = rope_in_scene(points, ends, length)
    points = remove_outliers(foreground(points, ends, length))
    if len(points) < LEAST_POINTS:
        raise FrameRejected(f"only {len(points)} points after outlier removal")
    known = np.asarray(np.isfinite(ends).all(axis=1))
    along = _geodesic(points, ends, known)
    moves = None
    if radius and viewpoint is not None:
        # The held ends lie on the axis: a line from there to the surface would slant.
        visible = _smooth_line(points, along, ends, np.zeros(2, dtype=bool))
        moves = _surface_to_axis(points, visible, radius, viewpoint)
        points = points + moves
    line = _smooth_line(points, along, ends, known)
    arc = polyline_arc(line)
    if arc[-1] <= 0:
        raise FrameRejected("the points do not extend along a line")
    if length and known.all() and not SHORTEST < arc[-1] / length < LONGEST:
        raise FrameRejected(
            f"the line through the points is {arc[-1]:.4g} m long, the rope {length:.4g} m: it "
            "crosses itself, too much is hidden, or [rope] length is wrong"
        )
    scale = length / arc[-1] if length and known.all() else 1.0
    place, _ = project_to_polyline(points, line)
    point_arc = np.interp(place, np.arange(len(line)), arc) * scale
    order = np.argsort(point_arc, kind="stable")
    order = order[np.unique(np.linspace(0, len(order) - 1, most).astype(int))]
    total = length if length and known.all() else float(arc[-1])
    return Trace(
        points=points[order],
        point_arc=point_arc[order],
        centreline=line,
        arc=arc * scale,
        length=total,
        reach=total / BINS,
        traced=float(arc[-1]),
        before=None if moves is None else np.linalg.norm(moves[order], axis=1),
    )


def _geodesic(points: np.ndarray, ends: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return (N,) distance along the cloud from end 0, by shortest paths over near neighbours.

    Separate pieces (occlusion) are joined by the shortest links between them. Raises FrameRejected
    where that makes no line.
    """
    nodes = np.concatenate([points, ends[known]])
    graph = bridge(neighbour_graph(nodes), nodes)

    def reach(start: int) -> np.ndarray:
        return dijkstra(graph, directed=False, indices=start)

    first = len(points) if known[0] else None
    last = len(nodes) - 1 if known[1] else None
    if first is None:
        first = int(np.argmax(reach(0 if last is None else last)))
    along = reach(first)
    if last is None:
        last = int(np.argmax(along))
    # Points on the way from end to end are no detour; those of a loop or of a branch are.
    detour = along + reach(last) - along[last]
    if np.mean(detour > BRANCH * along[last]) > BRANCH:
        raise FrameRejected(
            "the points do not form one line from end to end: the rope crosses or touches itself, "
            "or something else is in the cloud"
        )
    return along[: len(points)]


def _smooth_line(
    points: np.ndarray, along: np.ndarray, ends: np.ndarray, known: np.ndarray
) -> np.ndarray:
    """Return (M, 3) centreline: means over stretches of geodesic distance, smoothed, ends put
    back."""
    finite = np.isfinite(along)
    points, along = points[finite], along[finite]
    edges = np.linspace(along.min(), along.max() + 1e-9, BINS + 1)
    index = np.digitize(along, edges) - 1
    count = np.bincount(index, minlength=BINS)
    filled = count > 0
    means = np.stack([np.bincount(index, column, BINS) for column in points.T], axis=1)
    means = means[filled] / count[filled, None]
    centre = np.bincount(index, along, BINS)[filled] / count[filled]
    # Where an end is not known the rope reaches as far as its points, not the last mean of them.
    start = centre[0] if known[0] else along.min()
    stop = centre[-1] if known[1] else along.max()
    # Evenly spaced before smoothing, so that gaps do not pull.
    line = _smooth(_extended(means, centre, np.linspace(start, stop, BINS)))
    parts = [line]
    if known[0] and np.linalg.norm(line[0] - ends[0]) > 1e-6:
        parts.insert(0, ends[:1])
    if known[1] and np.linalg.norm(line[-1] - ends[1]) > 1e-6:
        parts.append(ends[1:])
    return without_overshoot(np.concatenate(parts))


def _extended(means: np.ndarray, centre: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return (M, 3) the polyline (B, 3) over centre (B,) at places (M,), straight on beyond its
    ends."""
    line = resample(means, centre, at)
    span = min(3, len(means) - 1)  # one step is too short to give a direction
    if span > 0:
        for outside, end, inner in ((at < centre[0], 0, span), (at > centre[-1], -1, -1 - span)):
            slope = (means[end] - means[inner]) / (centre[end] - centre[inner])
            line[outside] += (at[outside] - centre[end])[:, None] * slope
    return line


def _smooth(line: np.ndarray) -> np.ndarray:
    """Return Gaussian over neighbouring vertices (M, 3), applied to what it took away once more.

    A Gaussian alone moves a bend inwards by half its variance times the curvature (3 mm for a
    radius of 5 cm); the second pass gives that back. The ends are padded by reflection.
    """

    def once(values: np.ndarray) -> np.ndarray:
        head, tail = 2 * values[0] - values[6:0:-1], 2 * values[-1] - values[-2:-8:-1]
        return gaussian_filter1d(np.concatenate([head, values, tail]), 1.0, axis=0)[6:-6]

    first = once(line)
    return first + once(line - first)


def without_overshoot(line: np.ndarray, size: int = 3) -> np.ndarray:
    """Drop vertices of (M, D) next to an end that lie beyond it, by their first `size` columns: the
    end is where the rope stops."""
    for flip in (slice(None), slice(None, None, -1)):
        line = line[flip]
        while len(line) > 4:
            at = line[:4, :size]
            if (at[1] - at[0]) @ (at[3] - at[1]) >= 0:
                break
            line = np.delete(line, 1, axis=0)
        line = line[flip]
    return line


def _surface_to_axis(
    points: np.ndarray, line: np.ndarray, radius: float, viewpoint: np.ndarray
) -> np.ndarray:
    """Return (N, 3) [m] moves from the visible surface to the axis: away from the eye, across the
    rope.

    A point to the side of the line stands less far before the axis than one in its middle.
    """
    place, offset = project_to_polyline(points, line)
    edges = np.diff(line, axis=0)
    tangent = edges[np.minimum(place.astype(int), len(edges) - 1)]
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    ray = points - viewpoint
    ray -= (ray * tangent).sum(axis=1, keepdims=True) * tangent
    ray /= np.maximum(np.linalg.norm(ray, axis=1, keepdims=True), 1e-12)
    across = np.abs((offset * np.cross(tangent, ray)).sum(axis=1))
    height = np.sqrt(np.maximum(radius**2 - np.minimum(across, radius) ** 2, 0.0))
    return height[:, None] * ray


def scatter(points: np.ndarray, line: np.ndarray) -> float:
    """Return robust sd [m] of the points (N, 3) about the centreline, per component across it."""
    _, offset = project_to_polyline(points, line)
    distance = np.linalg.norm(offset, axis=1)
    # |two Gaussian components| has median 1.1774 sd.
    return float(np.median(distance) / 1.1774)
