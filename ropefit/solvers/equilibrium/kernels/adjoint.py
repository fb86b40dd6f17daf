"""Gradients of a loss of an equilibrium in everything that decides it: one more linear solve."""

from __future__ import annotations

import numpy as np

from ropefit.solvers.equilibrium.kernels.block_tridiagonal import (
    factor,
    set_schur,
    solve_columns,
)
from ropefit.solvers.equilibrium.kernels.hessian import assemble, cross, set_corner
from ropefit.solvers.equilibrium.kernels.small_matrices import solve_border
from ropefit.solvers.equilibrium.kernels.state import jointed, set_state
from ropefit.solvers.kernels.jit import helper, inlined


@helper
def adjoint_rope(rod, held, q, lam, x0, gx, gq, w, out):
    """Write the gradient of a loss with derivatives gx (N+1, 3), gq (N, 4) in nodes and frames.

    One solve with the transposed Hessian gives virtual turns in `turn`, and in `right` virtual
    forces of the supports and moves of node 0; each gradient is linear in them.
    """
    n, count = rod.length.shape[0], held.node.shape[0]
    set_state(rod, held, q, lam, x0, w)
    assemble(rod, held, lam, w)
    set_corner(rod, held, w)
    total = _load_columns(rod, held, q, gx, gq, w)
    factor(w, 0.0, 0.0, rod.length)
    solve_columns(w, count + 1, True)
    set_schur(w, count)
    for s in range(count):
        for i in range(n):
            for a in range(3):
                w.right[s, 0] -= w.border[i, a, s] * w.solved[i, a, count]
    if not solve_border(w.schur, w.right, w.small):
        out.length[:] = np.nan
        return
    for i in range(n):
        for a in range(3):
            t = w.solved[i, a, count]
            for s in range(count):
                t -= w.solved[i, a, s] * w.right[s, 0]
            w.turn[i, a] = t
    _pull_bends(rod, w, out)
    _pull_ends(rod, w, out)
    _pull_segments(rod, held, w, out)
    _pull_conditions(held, lam, w, total, out)


@inlined
def _load_columns(rod, held, q, gx, gq, w):
    """Write the derivative of the loss in the turns into the border's last column, that in the
    forces of the supports and in the place of node 0 into `right`, and the sums of gx beyond each
    segment; returns the sum of gx."""
    n, count = rod.length.shape[0], held.node.shape[0]
    b, right, suffix = w.border, w.right, w.sums
    for s in range(count + 3):
        right[s, 0] = 0.0
    t0, t1, t2 = 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        t0 += gx[i + 1, 0]
        t1 += gx[i + 1, 1]
        t2 += gx[i + 1, 2]
        suffix[i, 0], suffix[i, 1], suffix[i, 2] = t0, t1, t2
        r, u, g = w.frame[i], w.u[i], w.g[i]
        v0 = r[0, 0] * t0 + r[1, 0] * t1 + r[2, 0] * t2
        v1 = r[0, 1] * t0 + r[1, 1] * t1 + r[2, 1] * t2
        v2 = r[0, 2] * t0 + r[1, 2] * t1 + r[2, 2] * t2
        e0, e1, e2 = w.yields[i, 0] * v0, w.yields[i, 1] * v1, w.yields[i, 2] * v2
        p, h = q[i], gq[i]
        b[i, 0, count] = (
            g[1] * v2
            - g[2] * v1
            - u[1] * e2
            + u[2] * e1
            + 0.5 * (-h[0] * p[1] + h[1] * p[0] + h[2] * p[3] - h[3] * p[2])
        )
        b[i, 1, count] = (
            g[2] * v0
            - g[0] * v2
            - u[2] * e0
            + u[0] * e2
            + 0.5 * (-h[0] * p[2] - h[1] * p[3] + h[2] * p[0] + h[3] * p[1])
        )
        b[i, 2, count] = (
            g[0] * v1
            - g[1] * v0
            - u[0] * e1
            + u[1] * e0
            + 0.5 * (-h[0] * p[3] + h[1] * p[2] - h[2] * p[1] + h[3] * p[0])
        )
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                d = held.direction[s]
                for a in range(3):
                    v = r[0, a] * d[0] + r[1, a] * d[1] + r[2, a] * d[2]
                    right[s, 0] += v * (e0, e1, e2)[a]
    t0, t1, t2 = t0 + gx[0, 0], t1 + gx[0, 1], t2 + gx[0, 2]
    if held.free:
        right[count, 0], right[count + 1, 0], right[count + 2, 0] = t0, t1, t2
    return t0, t1, t2


@inlined
def _pull_bends(rod, w, out):
    """Write the gradients in stiffness and rest shape."""
    n, y = rod.length.shape[0], w.turn
    for j in range(n + 1):
        p = w.p[j]
        h, x1, x2, x3 = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
        for a in range(3):
            out.stiffness[j, a], out.rest[j, a] = 0.0, 0.0
        if not jointed(rod, j):
            continue
        for side in range(2):
            i = j - 1 + side
            if i < 0 or i >= n:
                continue
            f = h if side == 1 else -h
            z0 = f * y[i, 0] + x2 * y[i, 2] - x3 * y[i, 1]
            z1 = f * y[i, 1] + x3 * y[i, 0] - x1 * y[i, 2]
            z2 = f * y[i, 2] + x1 * y[i, 1] - x2 * y[i, 0]
            for a in range(3):
                z = (z0, z1, z2)[a]
                out.stiffness[j, a] -= (p[a + 1] - rod.rest[j, a + 1]) * z
                out.rest[j, a] += rod.stiffness[j, a] * z


@inlined
def _pull_ends(rod, w, out):
    """Write the gradients in the clamps' turns and in the end moments."""
    n, y, block = rod.length.shape[0], w.turn, w.block
    for end in range(2):
        j, i = (0, 0) if end == 0 else (n, n - 1)
        held_turn = jointed(rod, j)
        if held_turn:
            cross(w, j, block)
        for a in range(3):
            out.clamp[end, a] = 0.0
            out.moment[end, a] = 0.0
            for c in range(3):
                if held_turn:
                    v = block[a, c] if end == 0 else block[c, a]
                    out.clamp[end, a] -= v * y[i, c]
                out.moment[end, a] += w.frame[i, a, c] * y[i, c]


@inlined
def _pull_segments(rod, held, w, out):
    """Write the gradients in flexibility, length and load: with the supports' virtual moves added
    to the loss's derivative in the nodes."""
    n, count = rod.length.shape[0], held.node.shape[0]
    y, right, virtual = w.turn, w.right, w.sums
    s0, s1, s2 = 0.0, 0.0, 0.0
    if held.free:
        s0, s1, s2 = right[count, 0], right[count + 1, 0], right[count + 2, 0]
    for i in range(n):
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                for a in range(3):
                    virtual[i, a] += right[s, 0] * held.direction[s, a]
    out.load[0, 0], out.load[0, 1], out.load[0, 2] = s0, s1, s2
    for i in range(n):
        r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
        v = virtual[i]
        c0 = u[1] * y[i, 2] - u[2] * y[i, 1]
        c1 = u[2] * y[i, 0] - u[0] * y[i, 2]
        c2 = u[0] * y[i, 1] - u[1] * y[i, 0]
        h0 = r[0, 0] * v[0] + r[1, 0] * v[1] + r[2, 0] * v[2] + c0
        h1 = r[0, 1] * v[0] + r[1, 1] * v[1] + r[2, 1] * v[2] + c1
        h2 = r[0, 2] * v[0] + r[1, 2] * v[1] + r[2, 2] * v[2] + c2
        out.flexibility[i, 0], out.flexibility[i, 1], out.flexibility[i, 2] = (
            l * u[0] * h0, l * u[1] * h1, l * w.pull[i] * h2,
        )  # fmt: skip
        # g/l · (Rᵀ v) + y · (g/l x u) = g/l · (Rᵀ v + u x y)
        out.length[i] = (g[0] * h0 + g[1] * h1 + g[2] * h2) / l
        e0 = w.yields[i, 0] * h0 + y[i, 1] * g[2] - y[i, 2] * g[1]
        e1 = w.yields[i, 1] * h1 + y[i, 2] * g[0] - y[i, 0] * g[2]
        e2 = w.yields[i, 2] * h2 + y[i, 0] * g[1] - y[i, 1] * g[0]
        s0 += r[0, 0] * e0 + r[0, 1] * e1 + r[0, 2] * e2
        s1 += r[1, 0] * e0 + r[1, 1] * e1 + r[1, 2] * e2
        s2 += r[2, 0] * e0 + r[2, 1] * e1 + r[2, 2] * e2
        out.load[i + 1, 0], out.load[i + 1, 1], out.load[i + 1, 2] = s0, s1, s2


@inlined
def _pull_conditions(held, lam, w, total, out):
    """Write the gradients in the supports and in the place of node 0; those in the loads are
    there already."""
    right = w.right
    for a in range(3):
        out.anchor[a] = 0.0 if held.free else total[a]
    for s in range(held.node.shape[0]):
        out.offset[s], out.compliance[s] = 0.0, 0.0
        for a in range(3):
            out.direction[s, a] = 0.0
        if held.active[s]:
            out.offset[s] = -right[s, 0]
            out.compliance[s] = lam[s] * right[s, 0]
            for a in range(3):
                if not held.free:
                    out.anchor[a] += right[s, 0] * held.direction[s, a]
                out.direction[s, a] = (
                    lam[s] * out.load[held.node[s], a] + right[s, 0] * w.x[held.node[s], a]
                )
