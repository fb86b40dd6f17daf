"""Newton's method in a plane, ahead of that in space.

A rope that is held at both ends, by nothing else and unclamped, of a round section and bent at rest
about one axis at most, hangs in the plane of its ends and its load without twist. Where it starts
there, Newton's steps in space stay there too: one turn a segment and two reactions are all that
changes. Here the same steps are taken in these alone, for a tenth of the work. Where they are not
plainly those that would be taken in space (no shift of the Hessian, no step that is shortened)
nothing is changed. In either case `newton.py` goes on in space, and it alone says what is in
equilibrium, and stable.
"""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.equilibrium.kernels.state import jointed
from ropefit.solvers.kernels.jit import helper, inlined
from ropefit.solvers.kernels.rotations import rotation, turn_by

FLAT = 1e-12  # sine of the largest angle to the plane
# Columns of `Work.flat`, for each segment: its direction in the plane, how far it has turned in
# all, the load beyond it, the rest bend before it; its row of the system, then of the factor.
COS, SIN, TURN, LOAD1, LOAD2, REST, DIAGONAL, OFF, STEP, BORDER1, BORDER2 = range(11)


@helper
def solve_in_plane(rod, held, q, lam, x0, tolerance, limit, reach, w):
    """Take Newton's steps in the plane from q, λ (changed in place) until the last turned no
    segment by more than `reach` [rad].

    Returns how many were taken and the largest turn of the last; 0 and inf where none was.
    """
    n = rod.length.shape[0]
    if not (_plain(rod, held) and _lay_down(rod, held, q, lam, x0, w)):
        return 0, np.inf
    e = w.block  # the plane's two directions and its normal
    one = lam[0] * e[0, 0] + lam[1] * e[0, 1] + lam[2] * e[0, 2]
    two = lam[0] * e[1, 0] + lam[1] * e[1, 1] + lam[2] * e[1, 2]
    first, second, before, largest, steps = one, two, np.inf, np.inf, 0
    while largest >= reach:
        worst, gap1, gap2, c11, c12, c22 = _assemble(rod, held, x0, one, two, w)
        if worst < 1e-3 * tolerance:
            break
        if steps == limit or not worst < before:
            return 0, np.inf
        largest, d1, d2 = _solve(n, gap1, gap2, c11, c12, c22, w)
        if not largest < 1.0:
            return 0, np.inf
        one, two, before, steps = one + d1, two + d2, worst, steps + 1
    for i in range(n):
        turn_by(q[i], w.trial_x, w.flat[i, TURN], q[i])
    for a in range(3):
        lam[a] += (one - first) * e[0, a] + (two - second) * e[1, a]
    return steps, largest


@inlined
def _plain(rod, held):
    """Return whether the two ends alone are held, in place, and the rope's section is round."""
    n = rod.length.shape[0]
    plain = not held.free and held.node.shape[0] == 3 and not jointed(rod, 0)
    plain = plain and held.drag.shape[0] == 0 and held.axial.shape[0] == 0 and not jointed(rod, n)
    for s in range(3):
        if plain:
            plain = held.node[s] == n and held.active[s] and held.compliance[s] == 0.0
            for a in range(3):
                plain = plain and held.direction[s, a] == (1.0 if s == a else 0.0)
    for end in range(2):
        for a in range(3):
            plain = plain and rod.moment[end, a] == 0.0
    for i in range(n):
        plain = plain and rod.stiffness[i, 0] == rod.stiffness[i, 1]
        plain = plain and rod.flexibility[i, 0] == rod.flexibility[i, 1]
    return plain


@inlined
def _lay_down(rod, held, q, lam, x0, w):
    """Write the plane into `block`, its normal in every segment's own frame into `trial_x`, and
    where each segment lies in it; returns whether all is in it."""
    n, e, flat, normal = rod.length.shape[0], w.block, w.flat, w.trial_x
    for a in range(3):
        e[0, a], e[1, a] = held.offset[a] - x0[a], 0.0
        for k in range(n + 1):
            e[1, a] += rod.load[k, a]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        e[2, a] = e[0, b] * e[1, c] - e[0, c] * e[1, b]
    span = math.sqrt(e[0, 0] ** 2 + e[0, 1] ** 2 + e[0, 2] ** 2)
    size = math.sqrt(e[2, 0] ** 2 + e[2, 1] ** 2 + e[2, 2] ** 2)
    weight = math.sqrt(e[1, 0] ** 2 + e[1, 1] ** 2 + e[1, 2] ** 2)
    if not size > 1e-3 * span * weight:  # one end above the other, or no load: any plane
        return False
    for a in range(3):
        e[0, a] /= span
        e[2, a] /= size
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        e[1, a] = e[2, b] * e[0, c] - e[2, c] * e[0, b]
    f1, f2, inside = 0.0, 0.0, _within(lam, e)
    for i in range(n - 1, -1, -1):
        r = w.frame[i]
        rotation(q[i], r)
        f1 += _along(rod.load[i + 1], e[0])
        f2 += _along(rod.load[i + 1], e[1])
        flat[i, LOAD1], flat[i, LOAD2], flat[i, TURN] = f1, f2, 0.0
        flat[i, COS] = r[0, 2] * e[0, 0] + r[1, 2] * e[0, 1] + r[2, 2] * e[0, 2]
        flat[i, SIN] = r[0, 2] * e[1, 0] + r[1, 2] * e[1, 1] + r[2, 2] * e[1, 2]
        inside = inside and _within(rod.load[i + 1], e)
        for a in range(3):
            here = r[0, a] * e[2, 0] + r[1, a] * e[2, 1] + r[2, a] * e[2, 2]
            if i == n - 1:
                normal[a] = here
            inside = inside and abs(here - normal[a]) <= FLAT
    inside = inside and abs(normal[2]) <= FLAT
    for j in range(1, n):
        p = rod.rest[j]
        flat[j, REST] = p[1] * normal[0] + p[2] * normal[1] + p[3] * normal[2]
        for a in range(3):
            inside = inside and abs(p[a + 1] - flat[j, REST] * normal[a]) <= FLAT
    return inside


@inlined
def _along(v, e):
    return v[0] * e[0] + v[1] * e[1] + v[2] * e[2]


@inlined
def _within(v, e):
    """Return whether v (3,) lies in the plane."""
    return abs(_along(v, e[2])) <= FLAT * (abs(v[0]) + abs(v[1]) + abs(v[2]))


@inlined
def _assemble(rod, held, x0, one, two, w):
    """Write gradient, Hessian and border at the reactions one and two [N].

    Returns how far the state is from balance (as in `newton.py`), how far the end is from its place
    [m], and how much it yields to the reactions, frames held [m/N]: 11, 12, 22.
    """
    n, e, flat = rod.length.shape[0], w.block, w.flat
    gap1, gap2, whole = 0.0, 0.0, 0.0
    for a in range(3):
        gap1 += (held.offset[a] - x0[a]) * e[0, a]
        gap2 += (held.offset[a] - x0[a]) * e[1, a]
    scale, c11, c12, c22 = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        c, s, l = flat[i, COS], flat[i, SIN], rod.length[i]
        f1, f2 = flat[i, LOAD1] + one, flat[i, LOAD2] + two
        u, v = c * f1 + s * f2, c * f2 - s * f1  # the force along and across the segment
        y, z = l * rod.flexibility[i, 2], l * rod.flexibility[i, 0]
        g, h = l + y * u, z * v  # the edge
        gap1 -= c * g - s * h
        gap2 -= s * g + c * h
        whole += l
        scale = max(scale, (g * g + h * h) * (u * u + v * v))
        flat[i, STEP] = h * u - g * v
        flat[i, DIAGONAL] = g * u + h * v - y * v * v - z * u * u
        flat[i, BORDER1] = s * (g - z * u) + c * (h - y * v)
        flat[i, BORDER2] = c * (z * u - g) + s * (h - y * v)
        c11 += y * c * c + z * s * s
        c12 += (y - z) * c * s
        c22 += y * s * s + z * c * c
    for j in range(1, n):
        c, s, c0, s0 = flat[j, COS], flat[j, SIN], flat[j - 1, COS], flat[j - 1, SIN]
        half = math.sqrt(0.5 * (1 + c * c0 + s * s0))  # cosine of half the angle between the two
        p, k = 0.5 * (s * c0 - c * s0) / half, rod.stiffness[j, 0]
        m = k * (p - flat[j, REST])
        firm = 0.25 * (k * half * half - m * p)
        scale = max(scale, m * m, 1e-8 * k * k)
        flat[j - 1, STEP] -= 0.5 * m * half
        flat[j, STEP] += 0.5 * m * half
        flat[j - 1, DIAGONAL] += firm
        flat[j, DIAGONAL] += firm
        flat[j - 1, OFF] = -firm
    worst, total = 0.0, gap1 + gap2
    for i in range(n):
        worst = max(worst, abs(flat[i, STEP]))
        total += flat[i, STEP]
    gap = math.sqrt(gap1 * gap1 + gap2 * gap2)
    worst = max(worst / math.sqrt(max(scale, 1e-300)), gap / whole)
    if not math.isfinite(total):
        worst = np.inf
    return worst, gap1, gap2, c11, c12, c22


@inlined
def _solve(n, gap1, gap2, c11, c12, c22, w):
    """Turn the segments by Newton's step; returns the largest turn [rad], or infinity where a
    direction descends, and the steps of the reactions."""
    flat, negative = w.flat, 0
    s11, s12, s22, b1, b2 = -c11, -c12, -c22, -gap1, -gap2
    for i in range(n):
        if i > 0:
            f = flat[i - 1, OFF] / flat[i - 1, DIAGONAL]
            flat[i, DIAGONAL] -= f * flat[i - 1, OFF]
            flat[i, STEP] -= f * flat[i - 1, STEP]
            flat[i, BORDER1] -= f * flat[i - 1, BORDER1]
            flat[i, BORDER2] -= f * flat[i - 1, BORDER2]
        one = 1.0 / flat[i, DIAGONAL]
        negative += one < 0.0
        z1, z2 = one * flat[i, BORDER1], one * flat[i, BORDER2]
        s11 -= z1 * flat[i, BORDER1]
        s12 -= z1 * flat[i, BORDER2]
        s22 -= z2 * flat[i, BORDER2]
        b1 += z1 * flat[i, STEP]
        b2 += z2 * flat[i, STEP]
    det = s11 * s22 - s12 * s12
    # As many negative signs as there are reactions, or a direction descends.
    negative += 1 if det < 0.0 else (2 if s11 < 0.0 else 0)
    d1, d2 = (s22 * b1 - s12 * b2) / det, (s11 * b2 - s12 * b1) / det
    largest, turn, total = 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        right = flat[i, STEP] + flat[i, BORDER1] * d1 + flat[i, BORDER2] * d2
        if i < n - 1:
            right += flat[i, OFF] * turn
        turn = -right / flat[i, DIAGONAL]
        largest = max(largest, abs(turn))
        total += turn
        c, s = math.cos(turn), math.sin(turn)
        flat[i, COS], flat[i, SIN] = (
            flat[i, COS] * c - flat[i, SIN] * s,
            flat[i, SIN] * c + flat[i, COS] * s,
        )
        flat[i, TURN] += turn
    if negative != 2 or not math.isfinite(total + d1 + d2):
        largest = np.inf
    return largest, d1, d2
