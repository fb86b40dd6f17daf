"""Gradient and Hessian of the Lagrangian L of one rope, at the state in its scratch."""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.kernels.bends import add_square, cross_block, segment_block
from ropefit.solvers.kernels.jit import helper, inlined


@helper
def assemble(rod, held, lam, w):
    """Write gradient and Hessian of L at the state last given to `set_state`.

    A rope that may spin about its own tangent (no twist held, straight isotropic rest) has one
    direction without stiffness: `gauge` holds the spin of segment 0, which moves nothing else.
    Returns the largest moment [N m] that is balanced, for judging the residual, and the residual.
    """
    w.diagonal[:] = 0.0
    w.off[:] = 0.0
    scale = _add_segments(rod, held, w)
    scale = max(scale, _add_bends(rod, held, w))
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
    n, count = rod.length.shape[0], held.node.shape[0]
    last = count  # the column of the residual
    scale = 0.0
    for i in range(n):
        u, g = w.u[i], w.g[i]
        d0, d1, d2 = w.yields[i, 0], w.yields[i, 1], w.yields[i, 2]
        b = w.border[i]
        b[0, last] = -(g[1] * u[2] - g[2] * u[1])
        b[1, last] = -(g[2] * u[0] - g[0] * u[2])
        b[2, last] = -(g[0] * u[1] - g[1] * u[0])
        size = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        scale = max(scale, size)
        segment_block(g, u, d0, d1, d2, w.diagonal[i])
        r = w.frame[i]
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                d = held.direction[s]
                v0 = r[0, 0] * d[0] + r[1, 0] * d[1] + r[2, 0] * d[2]
                v1 = r[0, 1] * d[0] + r[1, 1] * d[1] + r[2, 1] * d[2]
                v2 = r[0, 2] * d[0] + r[1, 2] * d[1] + r[2, 2] * d[2]
                e0, e1, e2 = d0 * v0, d1 * v1, d2 * v2
                b[0, s] = -(e1 * u[2] - e2 * u[1] + g[1] * v2 - g[2] * v1)
                b[1, s] = -(e2 * u[0] - e0 * u[2] + g[2] * v0 - g[0] * v2)
                b[2, s] = -(e0 * u[1] - e1 * u[0] + g[0] * v1 - g[1] * v0)
            else:
                b[0, s], b[1, s], b[2, s] = 0.0, 0.0, 0.0
    return scale


@inlined
def _add_bends(rod, held, w):
    """Add what bend and friction elements give; returns the largest square of a moment."""
    n, last = rod.length.shape[0], held.node.shape[0]
    with_friction = held.drag.shape[0] > 0
    scale = 0.0
    for j in range(n + 1):
        k = rod.stiffness[j]
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        p, m = w.p[j], w.m[j]
        now = w.k[j]
        scale = max(scale, m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
        # Rounding in a frame costs this much, also where nothing is bent.
        scale = max(scale, 1e-8 * max(k[0], k[1], k[2]) ** 2)
        c0 = 0.5 * (p[2] * m[2] - p[3] * m[1])
        c1 = 0.5 * (p[3] * m[0] - p[1] * m[2])
        c2 = 0.5 * (p[1] * m[1] - p[2] * m[0])
        h = 0.5 * p[0]
        bend = 0.25 * (m[0] * p[1] + m[1] * p[2] + m[2] * p[3])
        x, y, z = 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
        # Rows of B2 = h + [v]x and of B1 = -h + [v]x with v = (x, y, z).
        if j < n:
            b = w.border[j]
            b[0, last] += h * m[0] - c0
            b[1, last] += h * m[1] - c1
            b[2, last] += h * m[2] - c2
            add_square(w.diagonal[j], now, h, x, y, z, bend)
            if with_friction:
                couple(w.coupling[j], p, 1.0, 1.0, w.diagonal[j])
        if j > 0:
            b = w.border[j - 1]
            b[0, last] += -h * m[0] - c0
            b[1, last] += -h * m[1] - c1
            b[2, last] += -h * m[2] - c2
            add_square(w.diagonal[j - 1], now, -h, x, y, z, bend)
            if with_friction:
                couple(w.coupling[j], p, -1.0, -1.0, w.diagonal[j - 1])
        if 0 < j < n:
            cross_block(p, m, now, w.off[j - 1])
            if with_friction:
                couple(w.coupling[j], p, -1.0, 1.0, w.off[j - 1])
    return scale


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
    cross_block(w.p[j], w.m[j], w.k[j], out)
    couple(w.coupling[j], w.p[j], -1.0, 1.0, out)


@helper
def set_corner(rod, held, w):
    """Write the second derivative of L in (λ, x_0), without the border's share."""
    count = held.node.shape[0]
    c = w.corner
    c[:] = 0.0
    for s in range(count):
        if not held.active[s]:
            c[s, s] = -1.0
            continue
        for t in range(s + 1):
            if not held.active[t]:
                continue
            total = 0.0
            ds, dt = held.direction[s], held.direction[t]
            for i in range(min(held.node[s], held.node[t])):
                r = w.frame[i]
                for a in range(3):
                    if w.yields[i, a] != 0.0:
                        vs = r[0, a] * ds[0] + r[1, a] * ds[1] + r[2, a] * ds[2]
                        vt = r[0, a] * dt[0] + r[1, a] * dt[1] + r[2, a] * dt[2]
                        total += w.yields[i, a] * vs * vt
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
