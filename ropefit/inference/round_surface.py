"""What points on the visible surface of a round rope tell of its axis.

A point lies by u to the side of the axis and by √(r² - u²) before it. So the depths on both flanks
tell where the axis is sideways, better than where the points happen to lie: these scatter over the
whole width. That holds whichever part of the surface the sensor sees.
"""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.kernels.jit import exact_helper, exact_kernel

HUBER = 2.0  # sd beyond which a point counts less
# sd beyond which a point is an outlier, and its weight then: among three points, one far off would
# draw the axis away, where the others lie on the flank of a surface that is not theirs.
OUTLIER, OUTLIER_WEIGHT = 6.0, 1e-3
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

    count = np.bincount(station, minlength=stations)
    inner = count[station] >= FIRM
    if inner.sum() < 2 * FIRM:
        inner = np.ones(len(values), bool)
    return axes(np.ascontiguousarray(values), station, count, inner, radius)


@exact_helper
def _off_surface(values, station, radius, place, off, slope):
    """Write how far points (N, 2) are off (N, 2) the surface, and how fast it falls there (N,)."""
    least, rim = (1 - OUTMOST**2) * radius**2, RIM * radius
    for i in range(len(station)):
        side = values[i, 0] - place[station[i], 0]
        high = slope[i] = 0.0
        if radius > 0.0:
            high = math.sqrt(max(radius**2 - side**2, least))
            near = min(max(side, -rim), rim)
            slope[i] = near / math.sqrt(radius**2 - near**2)
        off[i, 0], off[i, 1] = side, values[i, 1] + high - place[station[i], 1]


@exact_helper
def _middle(a, first, last, k):
    """Return what a[k] of a[first : last] sorted would be, with a rearranged (Hoare's FIND); numba
    takes a second to compile a sort."""
    low, high = first, last - 1
    while low < high:
        pivot, i, j = a[k], low, high
        while i <= j:
            while a[i] < pivot:
                i += 1
            while pivot < a[j]:
                j -= 1
            if i <= j:
                a[i], a[j] = a[j], a[i]
                i += 1
                j -= 1
        if j < k:
            low = i
        if k < i:
            high = j
    return a[k]


@exact_helper
def _median(a, first, last):
    """Return the median of a[first : last], with a rearranged."""
    k = first + (last - first - 1) // 2
    low = high = _middle(a, first, last, k)
    if (last - first) % 2 == 0:
        high = a[k + 1]
        for i in range(k + 2, last):
            high = min(high, a[i])
    return 0.5 * (low + high)


@exact_helper
def _medians(off, station, count, ordered, filled, d, place):
    """Write the medians of off[:, d], (N, 2), at every station into place[:, d], (M, 2)."""
    start = 0
    for s in range(len(count)):
        filled[s] = start
        start += count[s]
    for i in range(len(station)):
        ordered[filled[station[i]]] = off[i, d]
        filled[station[i]] += 1
    for s in range(len(count)):
        place[s, d] = _median(ordered, filled[s] - count[s], filled[s])


@exact_helper
def _pooled(off, weight, spare, inner, out):
    """Write (2,) [m²] variance of points off by (N, 2), of which a share (N, 2) is spared by the
    fit."""
    for d in range(2):
        square, spared = 0.0, 0.0
        for i in range(len(weight)):
            if inner[i]:
                square += (weight[i] * off[i, d]) ** 2
                spared += weight[i] ** 2 * spare[i, d]
        out[d] = max(square / spared, 1e-18)


@exact_kernel
def axes(values, station, count, inner, radius):
    """Return what `axis` does; inner (N,) bool: points that show their scatter."""
    points, stations = len(station), len(count)
    off, slope, weight = np.empty((points, 2)), np.empty(points), np.empty(points)
    place, fall = np.zeros((stations, 2)), np.empty((stations, 2))
    filled, scaled = np.empty(stations, np.int64), np.empty((2, points))
    for d in range(2):
        _off_surface(values, station, radius, place, off, slope)
        _medians(off, station, count, scaled[d], filled, d, place)
    furthest = radius if radius > 0.0 else np.inf
    spare, amount = np.empty((points, 2)), np.empty(stations)
    for i in range(points):  # a mean of n points takes one n-th of the variance with it
        spare[i, 0] = spare[i, 1] = 1 - 1 / max(count[station[i]], 2)
    sd, variance, total = np.empty(2), np.empty(2), np.empty((stations, 5))
    for _ in range(ROUNDS):
        _off_surface(values, station, radius, place, off, slope)
        k = 0
        for i in range(points):
            if inner[i]:
                for d in range(2):
                    scaled[d, k] = abs(off[i, d] / math.sqrt(spare[i, d]))
                k += 1
        for d in range(2):
            sd[d] = max(_median(scaled[d], 0, k) / 0.6745, 1e-9)
        for i in range(points):
            size = math.sqrt(0.5 * ((off[i, 0] / sd[0]) ** 2 + (off[i, 1] / sd[1]) ** 2))
            weight[i] = min(1.0, HUBER / max(size, 1e-12)) if size < OUTLIER else OUTLIER_WEIGHT
        _pooled(off, weight, spare, inner, variance)
        for s in range(stations):
            for c in range(5):
                total[s, c] = 0.0
        for i in range(points):
            s, w, t = station[i], weight[i], slope[i]
            total[s, 0] += w
            total[s, 1] += w * t
            total[s, 2] += w * t**2
            total[s, 3] += w * (off[i, 0] / variance[0] - t * off[i, 1] / variance[1])
            total[s, 4] += w * off[i, 1]
        for s in range(stations):  # of the symmetric matrix (side, both; both, deep)
            number, pull_side, pull_deep = total[s, 0], total[s, 3], total[s, 4] / variance[1]
            amount[s] = number
            fall[s, 0], fall[s, 1] = total[s, 1] / number, total[s, 2] / number
            side = number * (1 / variance[0] + fall[s, 1] / variance[1])
            both, deep = -number * fall[s, 0] / variance[1], number / variance[1]
            share = side * deep - both**2
            step = (deep * pull_side - both * pull_deep) / share
            place[s, 0] += min(max(step, -furthest), furthest)
            step = (side * pull_deep - both * pull_side) / share
            place[s, 1] += min(max(step, -furthest), furthest)
            total[s, 1], total[s, 2], total[s, 3] = side / share, both / share, deep / share
        for i in range(points):
            s, w, t = station[i], weight[i], slope[i]
            side, both, deep = total[s, 1], total[s, 2], total[s, 3]
            left = 1 - w * (t**2 * deep + 2 * t * both + side) / variance[1]
            spare[i, 0], spare[i, 1] = max(1 - w * deep / variance[0], 0.1), max(left, 0.1)
    _off_surface(values, station, radius, place, off, slope)
    _pooled(off, weight, spare, inner, variance)
    return place, amount, variance, fall
