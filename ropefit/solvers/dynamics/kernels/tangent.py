"""First-order changes of a clip in given directions, forward in time, in all of them at once."""

from __future__ import annotations

import numpy as np

from ropefit.solvers.dynamics.kernels.directions import (
    add_product,
    copy_all,
    meet_bodies,
    set_pasts,
    set_turning,
    set_yielding,
    solve_systems,
    transpose,
)
from ropefit.solvers.dynamics.kernels.histories import make_histories, set_histories
from ropefit.solvers.dynamics.kernels.rates import jointed, rates, step_ratio
from ropefit.solvers.dynamics.kernels.records import make_work
from ropefit.solvers.dynamics.kernels.system import settled
from ropefit.solvers.kernels.bends import set_cross
from ropefit.solvers.kernels.jit import helper, maker
from ropefit.solvers.kernels.rotations import rotation


@maker
def tangent_clip(rod, drive, v0, xs, qs, forces, d, every, out):
    """Write the derivatives of the nodes of one clip, out (P, T', N+1, 3), at every `every`-th of
    its T times.

    d: a `Change` with P behind.
    """
    steps, n, many = qs.shape[0], qs.shape[1], out.shape[0]
    w, half = make_work(n), np.zeros((6, 6))
    past = make_histories(steps, n)
    set_histories(rod, drive, xs, qs, v0, past)
    v, p, strain = past.v, past.p, past.strain
    # The last three times of what changes, and what the rates take from the past.
    dx, dv = np.zeros((3, n + 1, 3, many)), np.zeros((3, n + 1, 3, many))
    dp, ds = np.zeros((3, n + 1, 3, many)), np.zeros((3, n, 3, many))
    old_x, old_v = np.zeros((n + 1, 3, many)), np.zeros((n + 1, 3, many))
    old_p, old_s = np.zeros((n + 1, 3, many)), np.zeros((n, 3, many))
    turn, dy, b = np.zeros((n, 3, many)), np.zeros((n + 1, 3, many)), np.zeros((n, 6, many))
    vector, m, even = np.zeros((6, many)), np.zeros((3, 3)), np.zeros((n + 1, 3))
    for t in range(steps):
        if t > 0:
            settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w)
        _step(
            rod, drive, d, t, qs, p, strain, dx, dv, dp, ds, turn, m, even, vector, old_x, old_v,
            old_p, old_s, dy, b, w,
        )  # fmt: skip
        if t % every == 0:
            for s in range(many):
                for k in range(n + 1):
                    for a in range(3):
                        out[s, t // every, k, a] = dx[t % 3, k, a, s]


@helper
def _step(
    rod, drive, d, t, qs, p, strain, dx, dv, dp, ds, turn, m, even, vector, old_x, old_v, old_p,
    old_s, dy, b, w,
):  # fmt: skip
    """Write the changes at time t in every direction; turn and all from m on are scratch."""
    c0, c1, c2 = rates(drive.time, max(t, 1))
    now, one, two = t % 3, (t - 1) % 3, (t - 2) % 3
    if t == 0:
        copy_all(d.x0, dx[0])
        copy_all(d.v0, dv[0])
        copy_all(d.q0, turn)
    else:
        set_pasts(w.rate, dx[one], dx[two], old_x)
        set_pasts(w.rate, dv[one], dv[two], old_v)
        for k in range(even.shape[0]):
            even[k, 1], even[k, 2] = c1, c2
        set_pasts(even, dp[one], dp[two], old_p)
        set_pasts(even, ds[one], ds[two], old_s)
        _move_nodes(rod, drive, d, t, old_x, old_v, dy, w)
        _change_drag(rod, drive, d, step_ratio(drive.time, t), dv[one], dv[two], vector, dy, w)
        meet_bodies(rod, d.bodies, w, dy)
        _change_segments(rod, d, c0, old_s, dy, b, vector, m, w)
        _change_bends(rod, d, t, c0, old_p, b, vector, m, w)
        solve_systems(w, b, vector, m)
        _respond(b, dy, turn, dx[now], vector, m, w)
        _set_speeds(w.rate, dx[now], old_x, dv[now])
    _change_darboux(rod, d, t, p[t], turn, dp[now], m)
    _change_strains(rod, d, qs[t], strain[t], turn, dx[now], m, ds[now])


@helper
def _move_nodes(rod, drive, d, t, old_x, old_v, dy, w):
    """Write how the nodes move, the forces in the segments held and without bodies, into dy
    (N+1, 3, P)."""
    n, many = rod.length.shape[0], dy.shape[2]
    for k in range(n + 1):
        end, c = 0 if k == 0 else 1, w.rate[k, 0]
        if (k == 0 or k == n) and drive.held[end]:
            for a in range(3):
                for s in range(many):
                    dy[k, a, s] = d.ends[t, end, a, s]
            continue
        f = w.inverse_mass[k]
        by_x, by_v = f * (rod.mass[k] * c + w.air[k]), f * rod.mass[k]
        for a in range(3):
            z = w.z[k, a]
            v = c * z + w.old_x[k, a]
            acc, resisted = c * v + w.old_v[k, a], w.drag[k, 0] * v
            for s in range(many):
                dy[k, a, s] = f * (
                    d.load[k, a, s] - d.mass[k, s] * acc - d.spring[k, s] * z
                    - d.air[k, s] * resisted
                )  # fmt: skip
            for s in range(many):
                dy[k, a, s] -= by_x * old_x[k, a, s] + by_v * old_v[k, a, s]


@helper
def _change_drag(rod, drive, d, ratio, dv_one, dv_two, change, dy, w):
    """Add to dy what a change of the law of drag, and of the speed it is taken at, does; change
    (6, P) is scratch."""
    n, many = rod.length.shape[0], dy.shape[2]
    for k in range(n + 1):
        end = 0 if k == 0 else 1
        if (k == 0 or k == n) and drive.held[end]:
            continue
        knot, above, slope = int(w.drag[k, 1]), w.drag[k, 2], w.drag[k, 3]
        for s in range(many):
            change[0, s] = (1 - above) * d.drag[knot, s] + above * d.drag[knot + 1, s]
        if slope != 0.0:
            for a in range(3):
                by_one, by_two = slope * w.ahead[k, a] * (1 + ratio), slope * w.ahead[k, a] * ratio
                for s in range(many):
                    change[0, s] += by_one * dv_one[k, a, s] - by_two * dv_two[k, a, s]
        for a in range(3):
            v = w.rate[k, 0] * w.z[k, a] + w.old_x[k, a]
            f = w.inverse_mass[k] * w.air[k] * v
            for s in range(many):
                dy[k, a, s] -= f * change[0, s]


@helper
def _change_segments(rod, d, c0, old_s, dy, b, edge, m, w):
    """Write the residual b (N, 6, P) of the segments; edge (6, P) and m are scratch."""
    many = b.shape[2]
    for i in range(rod.length.shape[0]):
        r, u, l = w.frame[i], w.u[i], rod.length[i]
        for a in range(3):
            flexibility, vis = rod.flexibility[i, a], rod.strain_viscosity[i, a]
            even = 1 + flexibility * vis * c0
            rate = c0 * (w.g[i, a] / l - (a == 2)) + w.old_strain[i, a]
            by_length = w.g[i, a] / l
            by_flexibility = l * (u[a] - vis * w.old_strain[i, a]) / (even * even)
            yields = l * flexibility / even
            by_viscosity, by_past = yields * rate, yields * vis
            for s in range(many):
                edge[a, s] = (
                    d.length[i, s] * by_length + d.flexibility[i, a, s] * by_flexibility
                    - d.strain_viscosity[i, a, s] * by_viscosity - old_s[i, a, s] * by_past
                )  # fmt: skip
        for a in range(3):
            for s in range(many):
                b[i, a, s] = 0.0
                b[i, 3 + a, s] = dy[i + 1, a, s] - dy[i, a, s]
        set_turning(0.0, u[0], u[1], u[2], m)
        add_product(m, 1.0, edge, b[i], 0)
        add_product(r, -1.0, edge, b[i], 3)


@helper
def _change_bends(rod, d, t, c0, old_p, b, moment, m, w):
    """Add the residual of the bends and clamps; moment (6, P) and m (3, 3) are scratch."""
    n, many = rod.length.shape[0], b.shape[2]
    for j in range(n + 1):
        if not jointed(rod.stiffness, rod.bend_viscosity, j):
            continue
        pj = w.p[j]
        for a in range(3):
            strain, rate = pj[a + 1] - rod.rest[j, a + 1], c0 * pj[a + 1] + w.old_p[j, a]
            stiffness, viscosity = rod.stiffness[j, a], rod.bend_viscosity[j, a]
            for s in range(many):
                moment[a, s] = (
                    d.stiffness[j, a, s] * strain - stiffness * d.rest[j, a, s]
                    + d.bend_viscosity[j, a, s] * rate + viscosity * old_p[j, a, s]
                )  # fmt: skip
        h, x, y, z = 0.5 * pj[0], 0.5 * pj[1], 0.5 * pj[2], 0.5 * pj[3]
        if j < n:
            set_turning(h, -x, -y, -z, m)
            add_product(m, 1.0, moment, b[j], 0)
        if j > 0:
            set_turning(-h, -x, -y, -z, m)
            add_product(m, 1.0, moment, b[j - 1], 0)
        if j == 0 or j == n:
            set_cross(pj, w.m[j], w.firm[j], m)
            if j == 0:
                transpose(m)
            add_product(m, 1.0, d.clamp[t, 0 if j == 0 else 1], b[0 if j == 0 else n - 1], 0)


@helper
def _respond(b, dy, turn, dx, pull, m, w):
    """Write turns (N, 3, P) and moves of the nodes dx (N+1, 3, P) from the solution b (N, 6, P);
    pull (6, P) and m are scratch."""
    n, many = turn.shape[0], dy.shape[2]
    for i in range(n):
        for a in range(3):
            for s in range(many):
                turn[i, a, s] = -b[i, a, s]
    copy_all(dy, dx)
    for k in range(n + 1):
        before, after = max(k - 1, 0), min(k, n - 1)
        by_before, by_after = 1.0 * (k > 0), 1.0 * (k < n)
        for a in range(3):
            for s in range(many):
                pull[a, s] = by_before * b[before, 3 + a, s] - by_after * b[after, 3 + a, s]
        set_yielding(w, k, m)
        add_product(m, 1.0, pull, dx[k], 0)


@helper
def _set_speeds(rate, dx, old_x, dv):
    """Write the change of the nodes' speeds dv (N+1, 3, P)."""
    for k in range(dv.shape[0]):
        c = rate[k, 0]
        for a in range(3):
            for s in range(dv.shape[2]):
                dv[k, a, s] = c * dx[k, a, s] + old_x[k, a, s]


@helper
def _change_darboux(rod, d, t, p, turn, dp, m):
    """Write the change of the Darboux vectors dp (N+1, 3, P) by the turns beside them."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        for a in range(3):
            for s in range(dp.shape[2]):
                dp[j, a, s] = 0.0
        if jointed(rod.stiffness, rod.bend_viscosity, j):
            h, x, y, z = 0.5 * p[j, 0], 0.5 * p[j, 1], 0.5 * p[j, 2], 0.5 * p[j, 3]
            set_turning(-h, x, y, z, m)
            add_product(m, 1.0, d.clamp[t, 0] if j == 0 else turn[j - 1], dp[j], 0)
            set_turning(h, x, y, z, m)
            add_product(m, 1.0, d.clamp[t, 1] if j == n else turn[j], dp[j], 0)


@helper
def _change_strains(rod, d, q, strain, turn, dx, m, ds):
    """Write the change of the strains ds (N, 3, P) by turns, moves of the nodes and lengths."""
    for i in range(rod.length.shape[0]):
        l = rod.length[i]
        e = (strain[i, 0], strain[i, 1], strain[i, 2] + 1)
        for a in range(3):
            share = e[a] / l
            for s in range(ds.shape[2]):
                ds[i, a, s] = -share * d.length[i, s]
        set_turning(0.0, e[0], e[1], e[2], m)
        add_product(m, 1.0, turn[i], ds[i], 0)
        rotation(q[i], m)
        transpose(m)
        add_product(m, 1 / l, dx[i + 1], ds[i], 0)
        add_product(m, -1 / l, dx[i], ds[i], 0)
