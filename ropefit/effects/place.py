"""Places: on the rope as weights of nodes and segments, in space by gravity and the ends."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ropefit.rod.setup import Setup

SCAN_POINTS = 25  # places of a point effect along the rope
QUARTERS = (0, 25, 50, 75, 100)  # % of the length: where what varies along a whole rope is reported
AT_END = 0.03  # of the length: so near, a stretch reaches the end
SCAN_WIDTHS = (0.1, 0.2, 0.35, 0.6)  # of the length, of an interval effect

SPREAD = (np.arange(16) + 0.5) / 16 - 0.5  # of a width: where it is summed


def points_along(setup: Setup) -> np.ndarray:
    """Return (Q, 1) arc lengths [m] at which a scan tries a point effect."""
    length = float(setup.properties.length.sum())
    return _tried(setup, (np.linspace(0.02, 0.98, SCAN_POINTS) * length)[:, None])


def intervals_along(setup: Setup) -> np.ndarray:
    """Return (Q, 2) centres and widths [m] at which a scan tries an interval effect."""
    length = float(setup.properties.length.sum())
    every = [
        (c * length, w * length)
        for w in SCAN_WIDTHS
        for c in np.linspace(w / 2, 1 - w / 2, round(2.0 / w))
    ]
    return _tried(setup, np.array(every))


def _tried(setup: Setup, places: np.ndarray) -> np.ndarray:
    """Return every place of a rope at rest, every second of one in motion, where each is a
    simulation."""
    return places if setup.damping is None else places[::2]


def at_point(arc: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return (K,) shares of the nodes, at arc (K,) [m], in a point at `place` [m]; the sum is 1."""
    place = np.clip(place, 0.0, arc[-1])
    index = int(np.clip(np.searchsorted(arc, place, side="right"), 1, len(arc) - 1))
    share = (place - arc[index - 1]) / (arc[index] - arc[index - 1])
    out = np.zeros_like(arc)
    out[index - 1], out[index] = 1 - share, share
    return out


def around_point(arc: np.ndarray, place: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return (K,) shares of the nodes in something spread evenly over `width` [m] about a place.

    Cubic interpolation: the shares have the moments of the spread up to the third, so that neither
    the place between two nodes nor a width below a segment is lost. The sum is 1.
    """
    at = np.clip(place + width * SPREAD, 0.0, arc[-1])
    low = np.clip(np.searchsorted(arc, at, side="right") - 2, 0, len(arc) - 4)
    index = low[:, None] + np.arange(4)
    node = arc[index]  # (S, 4)
    other = ~np.eye(4, dtype=bool)
    apart = np.where(other, node[:, :, None] - node[:, None, :], 1.0)
    steps = (at[:, None, None] - node[:, None, :]) / apart
    share = np.where(other, steps, 1.0).prod(-1) / len(at)
    return np.bincount(index.ravel(), share.ravel(), len(arc))


def on_rope(centre: float, width: float, length: float) -> tuple[float, float, bool, bool]:
    """Return where a stretch begins and ends [m] on a rope of a length [m], and whether it reaches
    the rope's first and last end."""
    low, high = max(centre - width / 2, 0.0), min(centre + width / 2, length)
    return low, high, low < AT_END * length, high > (1 - AT_END) * length


def over_interval(arc: np.ndarray, centre: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return (N,) the fraction of each segment that lies within width/2 of the centre [m]."""
    low = np.maximum(arc[:-1], centre - width / 2)
    high = np.minimum(arc[1:], centre + width / 2)
    return np.maximum(high - low, 0.0) / np.diff(arc)


def nearest_node(setup: Setup, place: float, nodes: int) -> int:
    """Return the index of the node nearest to arc length `place` [m], of evenly spaced nodes."""
    return round(place / float(setup.properties.length.sum()) * (nodes - 1))


def horizontal(gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two horizontal unit vectors, which follow gravity (3,) smoothly while it is tilted."""
    return _horizontal(tuple(gravity.tolist()))


@lru_cache(maxsize=64)
def _horizontal(gravity: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    size = np.linalg.norm(gravity)
    down = np.array(gravity) / size if size > 0 else np.array([0.0, 0.0, -1.0])
    axis = np.zeros(3)
    axis[(int(np.abs(down).argmax()) + 1) % 3] = 1.0
    first = np.cross(down, axis)
    first = first / np.linalg.norm(first)
    second = np.cross(down, first)
    for vector in (first, second):
        vector.setflags(write=False)
    return first, second


def middle_of(setup: Setup) -> np.ndarray:
    """Return (3,) the mean of the held ends over all frames: an origin near the rope."""
    ends = setup.whole()[0].ends.reshape(-1, 3)
    return ends[~np.isnan(ends).any(-1)].mean(0)


def between_quarters(setup: Setup) -> np.ndarray:
    """Return (N, 5) how much every segment has of what is reported at each of `QUARTERS`."""
    length = np.ascontiguousarray(setup.properties.length, dtype=np.float64)
    return _between_quarters(length.tobytes())


@lru_cache(maxsize=64)
def _between_quarters(lengths: bytes) -> np.ndarray:
    length = np.frombuffer(lengths)
    share = (length.cumsum() - 0.5 * length) / length.sum()
    places = 0.01 * np.array(QUARTERS)
    out = np.maximum(1 - np.abs(share[:, None] - places) / (places[1] - places[0]), 0.0)
    out.setflags(write=False)
    return out
