"""Where a solve starts: a catenary, or a straight rope where an end is free, and its frames."""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.kernels.jit import exact_helper
from ropefit.solvers.kernels.rotations import director, product, smallest_turn


@exact_helper
def hang(arc, gravity, ends, tangents, shape):
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


@exact_helper
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


@exact_helper
def _inverse_sinhc(goal):
    """Return u > 0 with log(sinh(u) / u) = goal > 0, by Newton's method between bounds."""
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


@exact_helper
def frames_of(shape, arc, clamp, turns, q):
    """Return frames along a shape, from the first clamp without twist; what then is missing to the
    second clamp (and `turns` whole turns) is spread evenly over the arc length."""
    n = shape.shape[0] - 1
    tangent, before, turn = np.empty(3), np.array([0.0, 0.0, 1.0]), np.empty(4)
    frame = np.array([1.0, 0.0, 0.0, 0.0])
    held0, held1 = np.isfinite(clamp[0]).all(), np.isfinite(clamp[1]).all()
    if held0:
        frame[:] = clamp[0]
        director(frame, before)
    for i in range(n):
        tangent[:] = shape[i + 1] - shape[i]
        size = math.sqrt((tangent**2).sum())
        if size > 0:
            tangent /= size
            smallest_turn(before, tangent, turn)
            product(turn, frame, frame)
            before[:] = tangent
        q[i] = frame
    if not held1:
        return
    director(clamp[1], tangent)
    smallest_turn(before, tangent, turn)
    product(turn, frame, frame)
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
        product(q[i].copy(), turn, q[i])
