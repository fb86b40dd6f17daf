"""Where a solve starts: the catenary through the ends, or a straight rope where an end is free."""

from __future__ import annotations

import math

import numpy as np
import torch
from numba import njit
from torch import Tensor

from ropefit.rod.quaternion import transport

kernel = njit(cache=True, nogil=True, error_model="numpy")


def hanging_shape(
    length: float, nodes: int, gravity: np.ndarray, ends: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """(K, 3) [m] centreline evenly spaced in arc length, in equilibrium if the rope had no
    stiffness.

    ends, tangents: (2, 3), NaN where free or unclamped. Both ends: catenary (straight when taut; an
    arbitrary plane when one end hangs exactly above the other). One end: straight along its
    tangent, or down. Raises ValueError when both are free.
    """
    held = np.isfinite(ends).all(axis=1)
    if not held.any():
        raise ValueError("a rope with two free ends has no place to start from")
    shape = np.empty((nodes, 3))
    end = np.ascontiguousarray(ends, dtype=np.float64)
    tangent = np.ascontiguousarray(tangents, dtype=np.float64)
    arc = np.linspace(0.0, length, nodes)
    _hang(arc, np.ascontiguousarray(gravity, dtype=np.float64), end, tangent, shape)
    return shape


@kernel
def _hang(arc, gravity, ends, tangents, shape):
    """Write the shape; returns the tension's horizontal part over the weight per length [m]."""
    size = math.sqrt((gravity**2).sum())
    down = np.array([0.0, 0.0, -1.0])
    if size > 0:
        down = gravity / size
    length = arc[-1]
    held0, held1 = np.isfinite(ends[0]).all(), np.isfinite(ends[1]).all()
    if held0 and held1:
        return _catenary(arc, down, ends, shape)
    end = 0 if held0 else 1
    forward = down if end == 0 else -down
    if np.isfinite(tangents[end]).all():
        forward = tangents[end]
    start = 0.0 if end == 0 else length
    for k in range(arc.size):
        shape[k] = ends[end] + (arc[k] - start) * forward
    return 0.0


@kernel
def _catenary(arc, down, ends, shape):
    length = arc[-1]
    chord = ends[1] - ends[0]
    span = math.sqrt((chord**2).sum())
    if span >= length * (1 - 1e-9):
        for k in range(arc.size):
            shape[k] = ends[0] + arc[k] / length * chord
        return 5 * length
    rise = -(chord * down).sum()
    flat = chord + rise * down
    horizontal = math.sqrt((flat**2).sum())
    # Nearly above each other: open the fold by a thousandth of the length in some direction.
    least = 1e-3 * length
    if horizontal < least and horizontal <= 1e-12 * length:
        axis = np.zeros(3)
        axis[np.argmin(np.abs(down))] = 1.0
        flat = np.cross(down, axis)
    ahead = flat / math.sqrt((flat**2).sum())
    width = max(horizontal, least)
    # sinh(u)/u = ratio for u = width / (2 a), a the catenary's parameter.
    slack = max(length**2 - rise**2, width**2 * (1 + 1e-12))
    u = _inverse_sinhc(0.5 * math.log(slack) - math.log(width))
    a = width / (2 * u)
    lowest = (length - rise / math.tanh(u)) / 2  # arc length from end 0 to the lowest point
    for k in range(arc.size):
        s = arc[k] - lowest
        along = a * (math.asinh(s / a) - math.asinh(-lowest / a))
        height = math.hypot(a, s) - math.hypot(a, lowest)
        shape[k] = ends[0] + along * ahead - height * down
    miss = ends[1] - shape[-1]  # only where the fold was opened
    for k in range(arc.size):
        shape[k] += arc[k] / length * miss
    return a


@kernel
def _inverse_sinhc(goal):
    """u > 0 with log(sinh(u) / u) = goal > 0, by Newton's method between bounds."""
    low, high = 1e-8, 2 * goal + 40.0
    u = math.sqrt(6 * goal) if goal < 1 else goal + math.log(2 * goal + 2)
    for _ in range(100):
        value = (u * u / 6 if u < 1e-4 else u + math.log(-math.expm1(-2 * u) / (2 * u))) - goal
        if value > 0:
            high = u
        else:
            low = u
        slope = u / 3 if u < 1e-4 else 1 / math.tanh(u) - 1 / u
        change = -value / slope
        if not low < u + change < high:
            change = 0.5 * (low + high) - u
        u += change
        if abs(change) < 1e-14 * u:
            break
    return u


def frames_along(x: Tensor, first: Tensor | None = None, last: Tensor | None = None) -> Tensor:
    """(..., K-1, 4) twist-free frames of a centreline x (..., K, 3), clamps put in their places.

    first, last: (..., 4) held frames of the first and last segment, NaN where not held. The frames
    run from the first clamp if there is one, so that their arbitrary turn about the tangent is the
    clamp's.
    """
    edges = x[..., 1:, :] - x[..., :-1, :]
    norm = torch.sqrt((edges * edges).sum(-1, keepdim=True) + 1e-24)
    tangents = edges / norm
    fallback = torch.zeros_like(tangents)
    fallback[..., 2] = 1.0
    tangents = torch.where(norm > 1e-11, tangents, fallback)
    q = transport(tangents)
    for index, held in ((0, first), (-1, last)):
        if held is not None:
            given = torch.isfinite(held).all(-1, keepdim=True)
            near = q[..., index, :]
            held = torch.where(given, held, near)
            sign = torch.where((held * near).sum(-1, keepdim=True) < 0, -1.0, 1.0)
            place = torch.zeros(q.shape[-2], 1, dtype=torch.bool)
            place[index] = True
            q = torch.where(place, (sign * held)[..., None, :], q)
    return q


@kernel
def _smallest_turn(a, b, out):
    """Quaternion of least angle that turns the unit vector a into b."""
    real = 1 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if real < 1e-12:  # a half turn: any axis across a
        axis = np.zeros(3)
        axis[np.argmin(np.abs(a))] = 1.0
        across = np.cross(a, axis)
        out[0], out[1:] = 0.0, across / math.sqrt((across**2).sum())
        return
    out[0] = real
    out[1] = a[1] * b[2] - a[2] * b[1]
    out[2] = a[2] * b[0] - a[0] * b[2]
    out[3] = a[0] * b[1] - a[1] * b[0]
    out /= math.sqrt((out**2).sum())


@kernel
def _product(p, q, out):
    w = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    x = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    z = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@kernel
def _director(q, out):
    out[0] = 2 * (q[1] * q[3] + q[0] * q[2])
    out[1] = 2 * (q[2] * q[3] - q[0] * q[1])
    out[2] = 1 - 2 * (q[1] * q[1] + q[2] * q[2])


@kernel
def _frames(shape, arc, clamp, turns, q):
    """Frames along a shape, from the first clamp without twist; what then is missing to the second
    clamp (and `turns` whole turns) is spread evenly over the arc length."""
    n = shape.shape[0] - 1
    tangent, before, turn = np.empty(3), np.array([0.0, 0.0, 1.0]), np.empty(4)
    frame = np.array([1.0, 0.0, 0.0, 0.0])
    held0, held1 = np.isfinite(clamp[0]).all(), np.isfinite(clamp[1]).all()
    if held0:
        frame[:] = clamp[0]
        _director(frame, before)
    for i in range(n):
        tangent[:] = shape[i + 1] - shape[i]
        size = math.sqrt((tangent**2).sum())
        if size > 0:
            tangent /= size
            _smallest_turn(before, tangent, turn)
            _product(turn, frame, frame)
            before[:] = tangent
        q[i] = frame
    if not held1:
        return
    _director(clamp[1], tangent)
    _smallest_turn(before, tangent, turn)
    _product(turn, frame, frame)
    # About the common tangent: frame* clamp = (cos, 0, 0, sin) of half the missing angle.
    c = (frame * clamp[1]).sum()
    s = (
        frame[0] * clamp[1, 3]
        - clamp[1, 0] * frame[3]
        - (frame[1] * clamp[1, 2] - frame[2] * clamp[1, 1])
    )
    angle = 2 * math.atan2(s, c)
    angle -= 2 * math.pi * round(angle / (2 * math.pi))
    angle += 2 * math.pi * turns
    for i in range(n):
        # With nothing held at end 0 the whole rope takes the clamp's turn.
        share = 0.5 * (arc[i] + arc[i + 1]) / arc[n] if held0 else 1.0
        turn[0], turn[1], turn[2] = math.cos(0.5 * share * angle), 0.0, 0.0
        turn[3] = math.sin(0.5 * share * angle)
        _product(q[i].copy(), turn, q[i])


@kernel
def start_ropes(arc, of, gravity, ends, clamp, turns, q, x, pull):
    """Starts of F ropes: nodes x (F, K, 3) and frames q (F, K-1, 4).

    arc (R, K) [m] of rope of[t]; gravity (R, 3), of any size; ends (F, 2, 3), clamp (F, 2, 4), NaN
    where not held; turns (F,) whole turns of twist. pull (F,) [m]: horizontal tension over the
    weight per length.
    """
    tangents = np.empty((2, 3))
    for t in range(q.shape[0]):
        for end in range(2):
            _director(clamp[t, end], tangents[end])
        pull[t] = _hang(arc[of[t]], gravity[of[t]], ends[t], tangents, x[t])
        _frames(x[t], arc[of[t]], clamp[t], turns[t], q[t])
