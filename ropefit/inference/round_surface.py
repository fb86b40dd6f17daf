"""What points on the visible surface of a round rope tell of its axis.

A point lies by u to the side of the axis and by √(r² - u²) before it. So the depths on both flanks
tell where the axis is sideways, better than where the points happen to lie: these scatter over the
whole width. That holds whichever part of the surface the sensor sees.
"""

from __future__ import annotations

import numpy as np

HUBER = 2.0  # sd beyond which a point counts less
RIM = 0.75  # of the radius: further out the surface is too steep to be trusted
OUTMOST = 0.98  # of the radius: a sensor sees no further
ROUNDS = 6
FIRM = 5  # points of a station that show their own scatter


def surface(u: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the surface is before the axis at u (N,) to its side [m], and how fast it
    falls away there, no faster than near its rim. Without a radius there is no surface."""
    if not radius:
        return np.zeros_like(u), np.zeros_like(u)
    high = np.sqrt(np.maximum(radius**2 - u**2, (1 - OUTMOST**2) * radius**2))
    inner = np.clip(u, -RIM * radius, RIM * radius)
    return high, inner / np.sqrt(radius**2 - inner**2)


def information(
    count: np.ndarray, fall: np.ndarray, variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for stations' places, sideways, both, in depth (M,) [1/m²]: from their counts (M,),
    the sums over a count of fall and fall² (M, 2), and a point's variances (M, 2) [m²]."""
    side, deep = variance[..., 0], variance[..., 1]
    return count * (1 / side + fall[:, 1] / deep), -count * fall[:, 0] / deep, count / deep


def axis(
    values: np.ndarray, station: np.ndarray, stations: int, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where the axis is at each station, by least squares with Huber's weights.

    values (N, 2) [m]: of points, to the side and in depth, on the surface of a rope of `radius`
    [m]; with a radius of 0 on its axis, they are averaged then. Returns places (M, 2), effective
    counts (M,), variances of a point about the surface (2,) [m²], and `information`'s fall (M, 2).
    """
    if stations == 0:
        return np.zeros((0, 2)), np.zeros(0), np.zeros(2), np.zeros((0, 2))

    def total(of: np.ndarray) -> np.ndarray:
        return np.bincount(station, of, stations)

    def off_surface() -> tuple[np.ndarray, np.ndarray]:
        side = values[:, 0] - place[station, 0]
        before, fall = surface(side, radius)
        return np.stack([side, values[:, 1] + before - place[station, 1]], axis=1), fall

    count = total(np.ones(len(values)))
    place = np.zeros((stations, 2))
    for d in range(2):
        place[:, d] += _medians(off_surface()[0][:, d], station, count)
    furthest = radius or np.inf
    inner = count[station] >= FIRM
    if inner.sum() < 2 * FIRM:
        inner = np.ones(len(values), bool)
    # A mean of n points takes one n-th of the variance with it.
    spare = np.repeat(1 - 1 / np.maximum(count[station], 2)[:, None], 2, axis=1)
    for _ in range(ROUNDS):
        off, t = off_surface()
        sd = np.maximum(np.median(np.abs(off / np.sqrt(spare))[inner], axis=0) / 0.6745, 1e-9)
        size = np.sqrt(((off / sd) ** 2).mean(axis=1))
        weight = np.minimum(1.0, HUBER / np.maximum(size, 1e-12))
        variance = _pooled(off, weight, spare, inner)
        number = total(weight)
        fall = np.stack([total(weight * t), total(weight * t**2)], axis=1) / number[:, None]
        side, both, deep = information(number, fall, variance)
        share = side * deep - both**2
        pull_deep = total(weight * off[:, 1]) / variance[1]
        pull_side = total(weight * (off[:, 0] / variance[0] - t * off[:, 1] / variance[1]))
        step = [deep * pull_side - both * pull_deep, side * pull_deep - both * pull_side]
        place += np.clip(np.stack(step, axis=1) / share[:, None], -furthest, furthest)
        side, both, deep = ((v / share)[station] for v in (side, both, deep))
        spare[:, 0] = 1 - weight * deep / variance[0]
        spare[:, 1] = 1 - weight * (t**2 * deep + 2 * t * both + side) / variance[1]
        spare = np.maximum(spare, 0.1)
    return place, number, _pooled(off_surface()[0], weight, spare, inner), fall


def _medians(values: np.ndarray, station: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return (M,) of the values (N,) of every station."""
    ordered, start = values[np.lexsort((values, station))], np.cumsum(count) - count
    low, high = start + (count - 1) // 2, start + count // 2
    return 0.5 * (ordered[low.astype(int)] + ordered[high.astype(int)])


def _pooled(
    off: np.ndarray, weight: np.ndarray, spare: np.ndarray, inner: np.ndarray
) -> np.ndarray:
    """Return (2,) [m²] variance of points off by (N, 2), of which a share (N, 2) is spared by the
    fit."""
    square = (weight[:, None] * off)[inner] ** 2
    return np.maximum(square.sum(0) / (weight[:, None] ** 2 * spare)[inner].sum(0), 1e-18)
