"""Gradient and Hessian of the Lagrangian L of one rope, at the state in its scratch."""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.equilibrium.kernels.state import jointed
from ropefit.solvers.kernels.bends import (
    add_square,
    cross_block,
    segment_block,
    set_cross,
    square_blocks,
)
from ropefit.solvers.kernels.jit import helper, inlined


@helper
def assemble(rod, held, lam, w):
    """Write gradient and Hessian of L at the state last given to `set_state`.

    A rope that may spin about its own tangent (no twist held, straight isotropic rest) has one
    direction without stiffness: `gauge` holds the spin of segment 0, which moves nothing else.
    Returns the largest moment [N m] that is balanced, for judging the residual, and the residual.
    """
    scale = max(_add_segments(rod, held, w), _add_bends(rod, held, w))
    if held.drag.shape[0] > 0:
        _add_friction(rod, held, w)
    scale = max(scale, _add_end_moments(rod, held, w))
    w.diagonal[0, 2, 2] += rod.gauge
    last = held.node.shape[0]
    worst = 0.0
    for i in range(rod.length.shape[0]):
        for a in range(3):
            worst = max(worst, abs(w.border[i, a, last]))
            if not math.isfinite(w.border[i, a, last]):
                worst = np.inf
    return math.sqrt(scale), worst


@inlined
def _add_segments(rod, held, w):
    """Begin gradient, diagonal and border with the segments' own; returns the largest square of
    g u, to bound the moments of the forces."""
    last = held.node.shape[0]  # the column of the residual
    scale = 0.0
    for i in range(rod.length.shape[0]):
        u0, u1, u2 = w.u[i, 0], w.u[i, 1], w.u[i, 2]
        g0, g1, g2 = w.g[i, 0], w.g[i, 1], w.g[i, 2]
        d0, d1, d2 = w.yields[i, 0], w.yields[i, 1], w.yields[i, 2]
        w.border[i, 0, last] = g2 * u1 - g1 * u2
        w.border[i, 1, last] = g0 * u2 - g2 * u0
        w.border[i, 2, last] = g1 * u0 - g0 * u1
        scale = max(scale, (g0 * g0 + g1 * g1 + g2 * g2) * (u0 * u0 + u1 * u1 + u2 * u2))
        a00, a11, a22, a01, a02, a12 = segment_block(g0, g1, g2, u0, u1, u2, d0, d1, d2)
        w.diagonal[i, 0, 0], w.diagonal[i, 0, 1], w.diagonal[i, 0, 2] = a00, a01, a02
        w.diagonal[i, 1, 0], w.diagonal[i, 1, 1], w.diagonal[i, 1, 2] = a01, a11, a12
        w.diagonal[i, 2, 0], w.diagonal[i, 2, 1], w.diagonal[i, 2, 2] = a02, a12, a22
        for s in range(last):
            v0, v1, v2 = 0.0, 0.0, 0.0
            if held.active[s] and held.node[s] > i:
                x, y, z = held.direction[s, 0], held.direction[s, 1], held.direction[s, 2]
                v0 = w.frame[i, 0, 0] * x + w.frame[i, 1, 0] * y + w.frame[i, 2, 0] * z
                v1 = w.frame[i, 0, 1] * x + w.frame[i, 1, 1] * y + w.frame[i, 2, 1] * z
                v2 = w.frame[i, 0, 2] * x + w.frame[i, 1, 2] * y + w.frame[i, 2, 2] * z
            e0, e1, e2 = d0 * v0, d1 * v1, d2 * v2
            w.border[i, 0, s] = e2 * u1 - e1 * u2 + g2 * v1 - g1 * v2
            w.border[i, 1, s] = e0 * u2 - e2 * u0 + g0 * v2 - g2 * v0
            w.border[i, 2, s] = e1 * u0 - e0 * u1 + g1 * v0 - g0 * v1
    return scale


@inlined
def _add_bends(rod, held, w):
    """Add what bend and friction elements give; returns the largest square of a moment."""
    n, last = rod.length.shape[0], held.node.shape[0]
    scale = 0.0
    for j in range(n + 1):
        if not jointed(rod, j):
            if 0 < j < n:
                for a in range(3):
                    w.off[j - 1, a, 0], w.off[j - 1, a, 1], w.off[j - 1, a, 2] = 0.0, 0.0, 0.0
            continue
        m0, m1, m2 = w.m[j, 0], w.m[j, 1], w.m[j, 2]
        k0, k1, k2 = w.k[j, 0], w.k[j, 1], w.k[j, 2]
        p0, p1, p2, p3 = w.p[j, 0], w.p[j, 1], w.p[j, 2], w.p[j, 3]
        firm = max(rod.stiffness[j, 0], rod.stiffness[j, 1], rod.stiffness[j, 2])
        # Rounding in a frame costs this much, also where nothing is bent.
        scale = max(scale, m0 * m0 + m1 * m1 + m2 * m2, 1e-8 * firm * firm)
        c0, c1, c2 = 0.5 * (p2 * m2 - p3 * m1), 0.5 * (p3 * m0 - p1 * m2), 0.5 * (p1 * m1 - p2 * m0)
        h, bend = 0.5 * p0, 0.25 * (m0 * p1 + m1 * p2 + m2 * p3)
        block = square_blocks(k0, k1, k2, h, 0.5 * p1, 0.5 * p2, 0.5 * p3, bend)
        if j < n:
            w.border[j, 0, last] += h * m0 - c0
            w.border[j, 1, last] += h * m1 - c1
            w.border[j, 2, last] += h * m2 - c2
            add_square(w.diagonal, j, block, 1.0)
        if j > 0:
            w.border[j - 1, 0, last] -= h * m0 + c0
            w.border[j - 1, 1, last] -= h * m1 + c1
            w.border[j - 1, 2, last] -= h * m2 + c2
            add_square(w.diagonal, j - 1, block, -1.0)
        if 0 < j < n:
            a = cross_block(p0, p1, p2, p3, m0, m1, m2, k0, k1, k2)
            w.off[j - 1, 0, 0], w.off[j - 1, 0, 1], w.off[j - 1, 0, 2] = a[0], a[1], a[2]
            w.off[j - 1, 1, 0], w.off[j - 1, 1, 1], w.off[j - 1, 1, 2] = a[3], a[4], a[5]
            w.off[j - 1, 2, 0], w.off[j - 1, 2, 1], w.off[j - 1, 2, 2] = a[6], a[7], a[8]
    return scale


@helper
def _add_friction(rod, held, w):
    """Add what the friction elements couple between the two directions of bending."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if jointed(rod, j) and w.coupling[j] != 0.0:
            if j < n:
                couple(w.coupling[j], w.p[j], 1.0, 1.0, w.diagonal[j])
            if j > 0:
                couple(w.coupling[j], w.p[j], -1.0, -1.0, w.diagonal[j - 1])
            if 0 < j < n:
                couple(w.coupling[j], w.p[j], -1.0, 1.0, w.off[j - 1])


@inlined
def _add_end_moments(rod, held, w):
    """Add the moments given at the ends; returns the largest square of one."""
    n, last = rod.length.shape[0], held.node.shape[0]
    scale = 0.0
    for end in range(2):
        moment = rod.moment[end]
        if moment[0] != 0.0 or moment[1] != 0.0 or moment[2] != 0.0:
            i = 0 if end == 0 else n - 1
            r, a = w.frame[i], w.diagonal[i]
            t0 = r[0, 0] * moment[0] + r[1, 0] * moment[1] + r[2, 0] * moment[2]
            t1 = r[0, 1] * moment[0] + r[1, 1] * moment[1] + r[2, 1] * moment[2]
            t2 = r[0, 2] * moment[0] + r[1, 2] * moment[1] + r[2, 2] * moment[2]
            w.border[i, 0, last] -= t0
            w.border[i, 1, last] -= t1
            w.border[i, 2, last] -= t2
            # A moment that keeps its direction in space has no potential: not symmetric.
            a[0, 1] += 0.5 * t2
            a[0, 2] -= 0.5 * t1
            a[1, 0] -= 0.5 * t2
            a[1, 2] += 0.5 * t0
            a[2, 0] += 0.5 * t1
            a[2, 1] -= 0.5 * t0
            scale = max(scale, t0 * t0 + t1 * t1 + t2 * t2)
    return scale


@helper
def couple(c, p, before, after, out):
    """Add Bᵀ C B to out for the stiffness c between the first two directions of bending; before and
    after: -1 for B1, 1 for B2."""
    if c == 0.0:
        return
    h, x, y, z = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    a0, a1 = (before * h, -z, y), (z, before * h, -x)
    b0, b1 = (after * h, -z, y), (z, after * h, -x)
    for i in range(3):
        for j in range(3):
            out[i, j] += c * (a0[i] * b1[j] + a1[i] * b0[j])


@helper
def cross(w, j, out):
    """Write into out (3, 3) the second derivative in the turns before and after bend element j."""
    set_cross(w.p[j], w.m[j], w.k[j], out)
    couple(w.coupling[j], w.p[j], -1.0, 1.0, out)


@helper
def set_corner(rod, held, w):
    """Write the second derivative of L in (λ, x_0), without the border's share."""
    _set_give(w)
    count = held.node.shape[0]
    c = w.corner
    for s in range(count + 3):
        for t in range(count + 3):
            c[s, t] = 0.0
    for s in range(count):
        if not held.active[s]:
            c[s, s] = -1.0
            continue
        for t in range(s + 1):
            if not held.active[t]:
                continue
            k = min(held.node[s], held.node[t])
            x0, x1, x2 = held.direction[s, 0], held.direction[s, 1], held.direction[s, 2]
            y0, y1, y2 = held.direction[t, 0], held.direction[t, 1], held.direction[t, 2]
            total = (
                w.give[k, 0] * x0 * y0 + w.give[k, 1] * x1 * y1 + w.give[k, 2] * x2 * y2
                + w.give[k, 3] * (x0 * y1 + x1 * y0) + w.give[k, 4] * (x0 * y2 + x2 * y0)
                + w.give[k, 5] * (x1 * y2 + x2 * y1)
            )  # fmt: skip
            c[s, t] = -total
            c[t, s] = -total
        c[s, s] -= held.compliance[s]
    for a in range(3):
        if held.free:
            for s in range(count):
                if held.active[s]:
                    c[s, count + a] = -held.direction[s, a]
                    c[count + a, s] = -held.direction[s, a]
        else:
            c[count + a, count + a] = -1.0


@inlined
def _set_give(w):
    """Write into `give` how far each node yields to a unit force on it, all frames held: the sums
    of R diag(yields) Rᵀ up to it; 00, 11, 22, 01, 02, 12."""
    s00, s11, s22, s01, s02, s12 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(w.yields.shape[0]):
        for a in range(3):
            y = w.yields[i, a]
            if y != 0.0:
                r0, r1, r2 = w.frame[i, 0, a], w.frame[i, 1, a], w.frame[i, 2, a]
                s00 += y * r0 * r0
                s11 += y * r1 * r1
                s22 += y * r2 * r2
                s01 += y * r0 * r1
                s02 += y * r0 * r2
                s12 += y * r1 * r2
        w.give[i + 1, 0], w.give[i + 1, 1], w.give[i + 1, 2] = s00, s11, s22
        w.give[i + 1, 3], w.give[i + 1, 4], w.give[i + 1, 5] = s01, s02, s12
