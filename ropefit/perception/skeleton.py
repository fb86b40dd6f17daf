"""The medial line of a mask as one ordered path: longest way through the skeleton, spurs left
aside."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree
from skimage.morphology import skeletonize

from ropefit.perception.graph import bridge
from ropefit.perception.trace import FrameRejected

MOST_PIXELS = 60_000
SMOOTHING = 2.0  # px: skeleton pixels are jagged by one


def skeleton_path(mask: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """(P, 2) ordered pixels (u, v), sub-pixel, of the rope in a mask (H, W).

    ends (2, 2) [px] say where it starts and stops; without them it is the longest path. Pieces
    parted by occlusion are joined. None when there is nothing to follow.
    """
    rows, columns = np.nonzero(skeletonize(mask))
    if not 2 <= len(rows) <= MOST_PIXELS:
        return None
    pixels = np.column_stack([columns, rows]).astype(float)
    pairs = KDTree(pixels).query_pairs(1.5, output_type="ndarray")
    steps = np.linalg.norm(pixels[pairs[:, 0]] - pixels[pairs[:, 1]], axis=1)
    graph = coo_array((steps, pairs.T), shape=(len(pixels),) * 2).tocsr()
    try:
        graph = bridge(graph, pixels)
    except FrameRejected:
        return None
    first, last = (_nearest(pixels, end) for end in ends)
    if first is None:
        other = 0 if last is None else last
        first = _farthest(graph, _farthest(graph, other) if last is None else other)
    if last is None:
        last = _farthest(graph, first)
    distance, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    if not np.isfinite(distance[last]):
        return None
    path = [last]
    while path[-1] != first:
        path.append(before[path[-1]])
    return _smooth(pixels[path[::-1]])


def centred(path: np.ndarray, mask: np.ndarray, width: float) -> np.ndarray:
    """(P, 2) [px] the path moved sideways to the middle of the mask (H, W), `width` [px] wide.

    Thinning leaves whole pixels, and of two middle ones always the same: half a pixel of bias.
    """
    tangent = np.gradient(gaussian_filter1d(path, SMOOTHING, axis=0, mode="nearest"), axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    side = np.arange(0.0, width + 0.01, 0.25)
    inside = []
    for sign in (1, -1):
        at = path[:, None] + sign * side[:, None] * normal[:, None]
        share = map_coordinates(mask.astype(float), at[..., ::-1].transpose(2, 0, 1), order=1)
        # How far the mask reaches to this side before it is left for the first time.
        inside.append(0.25 * (share * np.minimum.accumulate(share > 0.25, axis=1)).sum(axis=1))
    shift = (inside[0] - inside[1]) / 2
    return _smooth(path + shift[:, None] * normal)


def _nearest(pixels: np.ndarray, point: np.ndarray) -> int | None:
    if not np.isfinite(point).all():
        return None
    return int(np.argmin(np.linalg.norm(pixels - point, axis=1)))


def _farthest(graph, start: int) -> int:
    distance = dijkstra(graph, directed=False, indices=start)
    return int(np.argmax(np.where(np.isfinite(distance), distance, -1)))


def _smooth(path: np.ndarray) -> np.ndarray:
    """Gaussian along the path between its jumps (bridged gaps stay sharp), tips kept."""
    jumps = np.flatnonzero(np.linalg.norm(np.diff(path, axis=0), axis=1) > 3) + 1
    parts = np.split(path, jumps)
    return np.concatenate(
        [gaussian_filter1d(part, SMOOTHING, axis=0, mode="nearest") for part in parts]
    )
