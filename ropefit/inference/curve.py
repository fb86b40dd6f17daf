"""The smooth curve through a rope's nodes: places on it, and the nearest ones to points.

A Catmull-Rom cubic, a parabola at the ends.
"""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.kernels.jit import exact_helper, exact_kernel

FINE = 4  # points of the curve for every segment
STRIDE = 4  # segments of the curve that are passed over at once


def _weights(t: np.ndarray) -> np.ndarray:
    """Return (M, 4) of the Catmull-Rom cubic at t in 0..1 between its second and third node."""
    return 0.5 * np.stack(
        [-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2],
        axis=-1,
    )


def _slopes(t: np.ndarray) -> np.ndarray:
    return 0.5 * np.stack(
        [-1 + 4 * t - 3 * t**2, -10 * t + 9 * t**2, 1 + 8 * t - 9 * t**2, 3 * t**2 - 2 * t], axis=-1
    )


def _padded(x: np.ndarray) -> np.ndarray:
    """Return nodes with one more at either end, so that the cubic is a parabola there."""
    first = 3 * x[:, :1] - 3 * x[:, 1:2] + x[:, 2:3]
    last = 3 * x[:, -1:] - 3 * x[:, -2:-1] + x[:, -3:-2]
    return np.concatenate([first, x, last], axis=1)


def refined(x: np.ndarray) -> np.ndarray:
    """Return (F, FINE (K-1) + 1, 3) points of the cubic through the nodes."""
    wide, n = _padded(x), x.shape[1] - 1
    fine = np.empty((len(x), FINE * n + 1, 3))
    for t, weight in enumerate(_weights(np.arange(FINE) / FINE)):
        fine[:, t:-1:FINE] = sum(w * wide[:, k : k + n] for k, w in enumerate(weight))
    fine[:, -1] = x[:, -1]
    return fine


def on_curve(x, frame, share):
    """Return segment (M,), weights (M, 4), unit tangents and places (M, 3) at shares of the
    length."""
    n = x.shape[1] - 1
    at = np.clip(share, 0, 1) * n
    segment = np.minimum(at.astype(np.int64), n - 1)
    t = at - segment
    weight, slope = _weights(t), _slopes(t)
    # Beyond the ends: the parabola's node in terms of the three next.
    for row in (weight, slope):
        first, last = segment == 0, segment == n - 1
        row[first] += row[first, :1] * np.array([0.0, 3.0, -3.0, 1.0])
        row[first, 0] = 0.0
        row[last] += row[last, 3:] * np.array([1.0, -3.0, 3.0, 0.0])
        row[last, 3] = 0.0
    place, tangent = np.zeros((len(frame), 3)), np.zeros((len(frame), 3))
    for k in range(4):
        node = np.clip(segment - 1 + k, 0, n)
        place += weight[:, k, None] * x[frame, node]
        tangent += slope[:, k, None] * x[frame, node]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return segment, weight, tangent, place


def across(tangent: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """Return (M, 2, 3): across the rope sideways to the ray, and across it along the ray."""
    side = np.cross(tangent, ray)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(tangent).argmin(axis=1)]
    side = np.where(
        size > 1e-6 * np.linalg.norm(ray, axis=1, keepdims=True), side, np.cross(tangent, axis)
    )
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([side, np.cross(side, tangent)], axis=1)


@exact_helper
def _square(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2


@exact_kernel
def feet(points, guess, mask, curve, window):
    """Find the nearest points of curves (F, M, 3) to points (F, P, 3) within `window` of their
    guess.

    Returns the foot's share of the curve (F, P), the offset (F, P, 3), and whether the foot is an
    inner point of the window, so that the offset lies across the curve.
    """
    frames, count = guess.shape
    last = curve.shape[1] - 1
    share = np.zeros((frames, count))
    offset = np.zeros((frames, count, 3))
    good = np.zeros((frames, count), dtype=np.bool_)
    for f in range(frames):
        reach = 0.0  # of the curve from a place, over the next STRIDE segments
        for k in range(last):
            reach = max(reach, STRIDE * math.sqrt(_square(curve[f, k], curve[f, k + 1])))
        for p in range(count):
            if not mask[f, p]:
                continue
            low = max(0, math.floor((guess[f, p] - window) * last))
            high = min(last, math.ceil((guess[f, p] + window) * last))
            # The foot is no further than the curve is where it was guessed.
            near = min(max(math.floor(guess[f, p] * last), low), high)
            furthest = (math.sqrt(_square(points[f, p], curve[f, near])) + reach) ** 2
            best, close = np.inf, False
            for k in range(low, high):
                if (k - low) % STRIDE == 0:
                    close = _square(points[f, p], curve[f, k]) <= furthest
                if not close:
                    continue
                e0 = curve[f, k + 1, 0] - curve[f, k, 0]
                e1 = curve[f, k + 1, 1] - curve[f, k, 1]
                e2 = curve[f, k + 1, 2] - curve[f, k, 2]
                d0 = points[f, p, 0] - curve[f, k, 0]
                d1 = points[f, p, 1] - curve[f, k, 1]
                d2 = points[f, p, 2] - curve[f, k, 2]
                t = (d0 * e0 + d1 * e1 + d2 * e2) / (e0 * e0 + e1 * e1 + e2 * e2)
                inside = 0.0 <= t <= 1.0
                # The end of the rope is a foot too if the point lies hardly beyond it.
                if t < 0.0:
                    inside = k > low or (k == 0 and t > -0.5)
                    t = 0.0
                elif t > 1.0:
                    inside = k < high - 1 or (k == last - 1 and t < 1.5)
                    t = 1.0
                d0 -= t * e0
                d1 -= t * e1
                d2 -= t * e2
                square = d0 * d0 + d1 * d1 + d2 * d2
                if square < best:
                    best = square
                    share[f, p] = (k + t) / last
                    offset[f, p, 0], offset[f, p, 1], offset[f, p, 2] = d0, d1, d2
                    good[f, p] = inside
    return share, offset, good
