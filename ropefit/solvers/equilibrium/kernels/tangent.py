"""First-order changes of an equilibrium in given directions: one more linear solve each.

The directions are the last index of what is solved for, and the innermost loop: along memory.
"""

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
def _turn_moments(p, dm, n, j, res, c):
    """Add the residual of the turns beside element j when its moment changes by dm."""
    h, x, y, z = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    c0, c1, c2 = y * dm[2] - z * dm[1], z * dm[0] - x * dm[2], x * dm[1] - y * dm[0]
    if j < n:
        res[j, 0, c] += h * dm[0] - c0
        res[j, 1, c] += h * dm[1] - c1
        res[j, 2, c] += h * dm[2] - c2
    if j > 0:
        res[j - 1, 0, c] += -h * dm[0] - c0
        res[j - 1, 1, c] += -h * dm[1] - c1
        res[j - 1, 2, c] += -h * dm[2] - c2


@helper
def _add_clamps(rod, w, turns, res, c):
    """Add the residual when the clamps turn by turns (2, 3) [rad]."""
    n, block = rod.length.shape[0], w.block
    for end in range(2):
        j = 0 if end == 0 else n
        if not jointed(rod, j):
            continue
        cross(w, j, block)
        for a in range(3):
            for b in range(3):
                if end == 0:
                    res[0, a, c] += block[b, a] * turns[0, b]
                else:
                    res[n - 1, a, c] += block[a, b] * turns[1, b]


@helper
def tangent_rope(rod, held, q, lam, x0, change, acts, clamp, anchor, offset, w, dx, turn):
    """Write the first-order change of the nodes dx (P, N+1, 3) and of the frames turn (P, N, 3).

    acts (2, P): which directions change bend elements, and segments: most change only a few fields.
    """
    n, count, many = rod.length.shape[0], held.node.shape[0], change.length.shape[0]
    set_state(rod, held, q, lam, x0, w)
    assemble(rod, held, lam, w)
    set_corner(rod, held, w)
    b = w.border
    right = w.right
    for c in range(many):
        for s in range(count + 3):
            right[s, c] = 0.0
        for i in range(n):
            for a in range(3):
                b[i, a, count + c] = 0.0
    _add_bends(rod, change, acts[0], w)
    for c in range(many):
        _add_clamps(rod, w, clamp[c], b, count + c)
    _add_segments(rod, change, acts[1], w, dx)
    _add_conditions(held, change, anchor, offset, dx, right)
    factor(w, 0.0, 0.0, rod.length)
    solve_columns(w, count + many, False)
    set_schur(w, count)
    for i in range(n):
        for a in range(3):
            for s in range(count):
                share = b[i, a, s]
                if share != 0.0:  # else beyond the node that is supported
                    for c in range(many):
                        right[s, c] += share * w.solved[i, a, count + c]
    if not solve_border(w.schur, right, w.small):
        dx[:] = np.nan
        return
    _add_response(rod, held, w, right, dx, turn)


@helper
def _add_bends(rod, change, acts, w):
    """Add each direction's residual when stiffness and rest shape change."""
    dm = w.trial_x
    n, many, b = rod.length.shape[0], change.length.shape[0], w.border
    first = b.shape[2] - many
    for j in range(n + 1):
        for c in range(many):
            if not acts[c]:
                continue
            for a in range(3):
                strain = w.p[j, a + 1] - rod.rest[j, a + 1]
                dm[a] = (
                    change.stiffness[c, j, a] * strain - rod.stiffness[j, a] * change.rest[c, j, a]
                )
            _turn_moments(w.p[j], dm, n, j, b, first + c)


@helper
def _add_segments(rod, change, acts, w, dx):
    """Add each direction's residual when loads, lengths, flexibilities and end moments change.

    Also writes the change of each edge, its frame held, into dx (P, N+1, 3).
    """
    n, many, b, beyond = rod.length.shape[0], change.length.shape[0], w.border, w.along
    first = b.shape[2] - many
    for a in range(3):
        for c in range(many):
            beyond[a, c] = 0.0
    for i in range(n - 1, -1, -1):
        r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
        for c in range(many):
            if not acts[c]:
                for a in range(3):
                    dx[c, i + 1, a] = 0.0
                continue
            for a in range(3):
                beyond[a, c] += change.load[c, i + 1, a]
            f0, f1, f2 = beyond[0, c], beyond[1, c], beyond[2, c]
            v0 = r[0, 0] * f0 + r[1, 0] * f1 + r[2, 0] * f2
            v1 = r[0, 1] * f0 + r[1, 1] * f1 + r[2, 1] * f2
            v2 = r[0, 2] * f0 + r[1, 2] * f1 + r[2, 2] * f2
            e0, e1, e2 = w.yields[i, 0] * v0, w.yields[i, 1] * v1, w.yields[i, 2] * v2
            dl = change.length[c, i] / l
            h0 = e0 + dl * g[0] + l * change.flexibility[c, i, 0] * u[0]
            h1 = e1 + dl * g[1] + l * change.flexibility[c, i, 1] * u[1]
            h2 = e2 + dl * g[2] + l * change.flexibility[c, i, 2] * w.pull[i]
            b[i, 0, first + c] -= h1 * u[2] - h2 * u[1] + g[1] * v2 - g[2] * v1
            b[i, 1, first + c] -= h2 * u[0] - h0 * u[2] + g[2] * v0 - g[0] * v2
            b[i, 2, first + c] -= h0 * u[1] - h1 * u[0] + g[0] * v1 - g[1] * v0
            for a in range(3):
                dx[c, i + 1, a] = r[a, 0] * h0 + r[a, 1] * h1 + r[a, 2] * h2
    for c in range(many):
        for end in range(2):
            i = 0 if end == 0 else n - 1
            r, m = w.frame[i], change.moment[c, end]
            for a in range(3):
                b[i, a, first + c] -= r[0, a] * m[0] + r[1, a] * m[1] + r[2, a] * m[2]


@helper
def _add_conditions(held, change, anchor, offset, dx, right):
    """Sum the changes of the edges to those of the nodes, and write the supports' residual."""
    many, nodes, count = dx.shape[0], dx.shape[1], held.node.shape[0]
    for c in range(many):
        for a in range(3):
            dx[c, 0, a] = 0.0 if held.free else anchor[c, a]
            for i in range(nodes - 1):
                dx[c, i + 1, a] += dx[c, i, a]
            if held.free:
                for i in range(nodes):
                    right[count + a, c] += change.load[c, i, a]
        for s in range(count):
            if held.active[s]:
                d, x = held.direction[s], dx[c, held.node[s]]
                right[s, c] = -(offset[c, s] - d[0] * x[0] - d[1] * x[1] - d[2] * x[2])


@helper
def _add_response(rod, held, w, right, dx, turn):
    """Write the turns (P, N, 3), and add what they and the reactions move to dx (P, N+1, 3)."""
    n, many, count = rod.length.shape[0], dx.shape[0], held.node.shape[0]
    z, along = w.solved, w.along
    for a in range(3):
        for c in range(many):
            along[3 + a, c] = right[count + a, c] if held.free else 0.0
            dx[c, 0, a] += along[3 + a, c]
    for i in range(n):
        r, u, g = w.frame[i], w.u[i], w.g[i]
        _add_reactions(held, right, i, z, along)
        # Contiguous in c, so that it is vectorised; turn and dx, which are not, are written after.
        _move(r, u, g, w.yields[i], z[i, :, count:], along)
        for c in range(many):
            for a in range(3):
                turn[c, i, a] = -z[i, a, count + c]
                dx[c, i + 1, a] += along[3 + a, c]


@inlined
def _move(r, u, g, yields, z, along):
    """Add to the move of a segment's far node, in each direction, what its turn -z (3, P) and the
    force on it (the first rows of `along`) do."""
    r00, r01, r02 = r[0, 0], r[0, 1], r[0, 2]
    r10, r11, r12 = r[1, 0], r[1, 1], r[1, 2]
    r20, r21, r22 = r[2, 0], r[2, 1], r[2, 2]
    u0, u1, u2, g0, g1, g2 = u[0], u[1], u[2], g[0], g[1], g[2]
    y0, y1, y2 = yields[0], yields[1], yields[2]
    for c in range(z.shape[1]):
        f0, f1, f2 = along[0, c], along[1, c], along[2, c]
        t0, t1, t2 = -z[0, c], -z[1, c], -z[2, c]
        v0 = r00 * f0 + r10 * f1 + r20 * f2 + u1 * t2 - u2 * t1
        v1 = r01 * f0 + r11 * f1 + r21 * f2 + u2 * t0 - u0 * t2
        v2 = r02 * f0 + r12 * f1 + r22 * f2 + u0 * t1 - u1 * t0
        e0 = t1 * g2 - t2 * g1 + y0 * v0
        e1 = t2 * g0 - t0 * g2 + y1 * v1
        e2 = t0 * g1 - t1 * g0 + y2 * v2
        along[3, c] += r00 * e0 + r01 * e1 + r02 * e2
        along[4, c] += r10 * e0 + r11 * e1 + r12 * e2
        along[5, c] += r20 * e0 + r21 * e1 + r22 * e2


@helper
def _add_reactions(held, right, i, z, along):
    """Add what the supports' reactions turn segment i by, and write the force that those beyond it
    pull with into the first rows of `along`."""
    count, many = held.node.shape[0], along.shape[1]
    passed = i == 0
    for s in range(count):
        passed = passed or held.node[s] == i
        for a in range(3):
            share = z[i, a, s]
            for c in range(many):
                z[i, a, count + c] += share * right[s, c]
    if not passed:
        return
    for a in range(3):
        for c in range(many):
            along[a, c] = 0.0
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                for c in range(many):
                    along[a, c] += right[s, c] * held.direction[s, a]
