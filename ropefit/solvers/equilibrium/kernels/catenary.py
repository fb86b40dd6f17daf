"""Where a solve starts: a catenary, or a straight rope where an end is free, and its frames."""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.kernels.jit import exact_helper
from ropefit.solvers.kernels.rotations import director, perpendicular, product, smallest_turn

MOST_FORCE = 1e6  # N: the largest force that a solve starts with


@exact_helper
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@exact_helper
def _finite(v):
    """Return whether all of v is finite."""
    total = 0.0
    for value in v:
        total += 0.0 * value
    return total == 0.0


@exact_helper
def hang(arc, gravity, ends, tangents, shape):
    """Write the shape; returns the tension's horizontal part over the weight per length [m]."""
    down, size = np.zeros(3), math.sqrt(_dot(gravity, gravity))
    down[2] = -1.0
    if size > 0:
        for a in range(3):
            down[a] = gravity[a] / size
    held = _finite(ends[0])
    if held and _finite(ends[1]):
        return _catenary(arc, down, ends, shape)
    end, start, sign = (0, 0.0, 1.0) if held else (1, arc[-1], -1.0)
    clamped = _finite(tangents[end])
    for a in range(3):
        forward = tangents[end, a] if clamped else sign * down[a]
        for k in range(arc.size):
            shape[k, a] = ends[end, a] + (arc[k] - start) * forward
    return 0.0


@exact_helper
def _catenary(arc, down, ends, shape):
    length, chord, flat = arc[-1], np.empty(3), np.empty(3)
    for a in range(3):
        chord[a] = ends[1, a] - ends[0, a]
    span = math.sqrt(_dot(chord, chord))
    if span >= length * (1 - 1e-9):
        for k in range(arc.size):
            for a in range(3):
                shape[k, a] = ends[0, a] + arc[k] / length * chord[a]
        return 5 * length
    rise = -_dot(chord, down)
    for a in range(3):
        flat[a] = chord[a] + rise * down[a]
    horizontal = math.sqrt(_dot(flat, flat))
    # Nearly above each other: open the fold by a thousandth of the length in some direction.
    least = 1e-3 * length
    if horizontal < least and horizontal <= 1e-12 * length:
        perpendicular(down, flat)
    size = math.sqrt(_dot(flat, flat))
    width = max(horizontal, least)
    # sinh(u)/u = ratio for u = width / (2 a), a (scale) the catenary's parameter.
    slack = max(length**2 - rise**2, width**2 * (1 + 1e-12))
    u = _inverse_sinhc(0.5 * math.log(slack) - math.log(width))
    scale = width / (2 * u)
    lowest = (length - rise / math.tanh(u)) / 2  # arc length from end 0 to the lowest point
    for k in range(arc.size):
        s = arc[k] - lowest
        along = scale * (math.asinh(s / scale) - math.asinh(-lowest / scale))
        height = math.hypot(scale, s) - math.hypot(scale, lowest)
        for a in range(3):
            shape[k, a] = ends[0, a] + along * (flat[a] / size) - height * down[a]
    for a in range(3):
        miss = ends[1, a] - shape[-1, a]  # only where the fold was opened
        for k in range(arc.size):
            shape[k, a] += arc[k] / length * miss
    return scale


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
    tangent, before, turn, frame = np.empty(3), np.zeros(3), np.empty(4), np.zeros(4)
    before[2], frame[0], held = 1.0, 1.0, _finite(clamp[0])
    if held:
        for k in range(4):
            frame[k] = clamp[0, k]
        director(frame, before)
    for i in range(n):
        for a in range(3):
            tangent[a] = shape[i + 1, a] - shape[i, a]
        size = math.sqrt(_dot(tangent, tangent))
        if size > 0:
            for a in range(3):
                tangent[a] /= size
            smallest_turn(before, tangent, turn)
            product(turn, frame, frame)
            for a in range(3):
                before[a] = tangent[a]
        for k in range(4):
            q[i, k] = frame[k]
    if not _finite(clamp[1]):
        return
    director(clamp[1], tangent)
    smallest_turn(before, tangent, turn)
    product(turn, frame, frame)
    # About the common tangent: frame* clamp = (cos, 0, 0, sin) of half the missing angle.
    c = frame[0] * clamp[1, 0] + _dot(frame[1:], clamp[1, 1:])
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
        share = 0.5 * (arc[i] + arc[i + 1]) / arc[n] if held else 1.0
        turn[0], turn[1], turn[2] = math.cos(0.5 * share * angle), 0.0, 0.0
        turn[3] = math.sin(0.5 * share * angle)
        product(q[i], turn, q[i])


@exact_helper
def roll(q, rest):
    """Roll all frames q (N, 4) alike about their own tangents until they bend, on the whole, as
    they are bent at rest (N+1, 4); of a rope that no clamp keeps from that."""
    n, turn = q.shape[0], np.zeros(4)
    a0, a1, b0, b1 = 0.0, 0.0, 0.0, 0.0
    for j in range(1, n):
        a0 += rest[j, 1]
        a1 += rest[j, 2]
        v, w = q[j - 1], q[j]
        b0 += v[0] * w[1] - v[1] * w[0] - v[2] * w[3] + v[3] * w[2]
        b1 += v[0] * w[2] - v[2] * w[0] - v[3] * w[1] + v[1] * w[3]
    if not (math.isfinite(a0) and math.isfinite(a1)) or (a0 == 0.0 and a1 == 0.0):
        return
    half = 0.5 * math.atan2(b1 * a0 - b0 * a1, b0 * a0 + b1 * a1)
    turn[0], turn[3] = math.cos(half), math.sin(half)
    for i in range(n):
        product(q[i], turn, q[i])


@exact_helper
def pull_at_end(shape, length, weight, load, scale, out):
    """Write what holds the last node of a catenary (3,) [N]: the tension in the last segment, less
    the load on the node; scale [m] as `hang` returns it."""
    last = np.empty(3)
    for a in range(3):
        last[a] = shape[-1, a] - shape[-2, a]
    edge, whole = math.sqrt(_dot(last, last)), math.sqrt(_dot(weight, weight))
    along = _dot(last, weight) / max(edge, 1e-300) / max(whole, 1e-300)
    tension = whole / length * scale / math.sqrt(max(1 - along * along, 1e-6))
    for a in range(3):
        pull = tension * last[a] / max(edge, 1e-300) - load[a]
        if pull > MOST_FORCE:
            pull = MOST_FORCE
        elif pull < -MOST_FORCE:
            pull = -MOST_FORCE
        out[a] = pull
