"""First-order changes of a clip in given directions, forward in time."""

from __future__ import annotations

import numpy as np

from ropefit.solvers.dynamics.kernels.block_tridiagonal import solve_system
from ropefit.solvers.dynamics.kernels.contact import meet_bodies
from ropefit.solvers.dynamics.kernels.histories import histories
from ropefit.solvers.dynamics.kernels.rates import (
    across,
    across_back,
    jointed,
    rates,
    set_nodes_past,
    set_past,
    step_ratio,
)
from ropefit.solvers.dynamics.kernels.records import make_work
from ropefit.solvers.dynamics.kernels.system import settled
from ropefit.solvers.kernels.bends import set_cross
from ropefit.solvers.kernels.jit import copy_rows, helper, inlined, maker
from ropefit.solvers.kernels.rotations import rotation


@maker
def tangent_clip(rod, drive, v0, xs, qs, forces, d, every, out):
    """Write the derivatives of the nodes of one clip, out (P, T', N+1, 3), at every `every`-th of
    its T times.

    d: a `Change` with P in front.
    """
    steps, n, many = qs.shape[0], qs.shape[1], out.shape[0]
    w, half = make_work(n), np.zeros((6, 6))
    v, p, strain = histories(rod, drive, xs, qs, v0, half[:3, :3])
    dx, dv = np.zeros((many, 3, n + 1, 3)), np.zeros((many, 3, n + 1, 3))
    dp, ds = np.zeros((many, 3, n + 1, 3)), np.zeros((many, 3, n, 3))
    turn, block, vector = np.zeros((n, 3)), np.zeros((3, 3)), np.empty(3)
    old_x, old_v, old_p = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    old_s, dy, b = np.zeros((n, 3)), np.zeros((n + 1, 3)), np.zeros((n, 6))
    for t in range(steps):
        if t > 0:
            settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w)
        _step(
            rod, drive, d, t, qs, p, strain, dx, dv, dp, ds, turn, block, vector, old_x, old_v,
            old_p, old_s, dy, b, half, w,
        )  # fmt: skip
        if t % every == 0:
            for s in range(many):
                copy_rows(dx[s, t % 3], out[s, t // every])


@helper
def _step(
    rod, drive, d, t, qs, p, strain, dx, dv, dp, ds, turn, block, vector, old_x, old_v, old_p,
    old_s, dy, b, half, w,
):  # fmt: skip
    """Write the changes at time t in every direction; turn and all from block on are scratch."""
    n = turn.shape[0]
    c0, c1, c2 = rates(drive.time, max(t, 1))
    ratio = step_ratio(drive.time, t)
    now, one, two = t % 3, (t - 1) % 3, (t - 2) % 3
    for s in range(dx.shape[0]):
        if t == 0:
            copy_rows(d.x0[s], dx[s, 0])
            copy_rows(d.v0[s], dv[s, 0])
            copy_rows(d.q0[s], turn)
        else:
            set_nodes_past(w.rate, dx[s, one], dx[s, two], old_x)
            set_nodes_past(w.rate, dv[s, one], dv[s, two], old_v)
            set_past(c1, c2, dp[s, one], dp[s, two], old_p)
            set_past(c1, c2, ds[s, one], ds[s, two], old_s)
            _move_nodes(rod, drive, d, s, t, old_x, old_v, dy, w)
            _change_drag(rod, drive, d, s, ratio, dv[s, one], dv[s, two], dy, w)
            meet_bodies(rod, d.bodies[s], w, dy)
            _change_segments(rod, d, s, c0, old_s, dy, b, vector, w)
            _change_bends(rod, d, s, t, c0, old_p, b, vector, block, w)
            solve_system(w, b, half[0])
            _respond(b, dy, turn, dx[s, now], w)
            for k in range(n + 1):
                for a in range(3):
                    dv[s, now, k, a] = w.rate[k, 0] * dx[s, now, k, a] + old_x[k, a]
        _change_darboux(rod, d, s, t, p[t], turn, dp[s, now])
        _change_strains(rod, d, s, qs[t], strain[t], turn, dx[s, now], block, ds[s, now])


@inlined
def _move_nodes(rod, drive, d, s, t, old_x, old_v, dy, w):
    """Write how direction s moves the nodes, the forces in the segments held and without bodies,
    into dy (N+1, 3)."""
    n = rod.length.shape[0]
    for k in range(n + 1):
        end, c = 0 if k == 0 else 1, w.rate[k, 0]
        fixed = (k == 0 or k == n) and drive.held[end]
        for a in range(3):
            if fixed:
                dy[k, a] = d.ends[s, t, end, a]
                continue
            v = c * w.z[k, a] + w.old_x[k, a]
            acc = c * v + w.old_v[k, a]
            dy[k, a] = w.inverse_mass[k] * (
                d.load[s, k, a] - d.mass[s, k] * acc - d.spring[s, k] * w.z[k, a]
                - d.air[s, k] * w.drag[k, 0] * v
                - (rod.mass[k] * c + w.air[k]) * old_x[k, a]
                - rod.mass[k] * old_v[k, a]
            )  # fmt: skip


@inlined
def _change_drag(rod, drive, d, s, ratio, dv_one, dv_two, dy, w):
    """Add to dy what a change of the law of drag, and of the speed it is taken at, does."""
    n = rod.length.shape[0]
    for k in range(n + 1):
        end = 0 if k == 0 else 1
        if (k == 0 or k == n) and drive.held[end]:
            continue
        knot, above, change = int(w.drag[k, 1]), w.drag[k, 2], 0.0
        for a in range(3):
            faster = dv_one[k, a] + ratio * (dv_one[k, a] - dv_two[k, a])
            change += w.ahead[k, a] * faster
        change *= w.drag[k, 3]
        change += (1 - above) * d.drag[s, knot] + above * d.drag[s, knot + 1]
        for a in range(3):
            v = w.rate[k, 0] * w.z[k, a] + w.old_x[k, a]
            dy[k, a] -= w.inverse_mass[k] * w.air[k] * change * v


@inlined
def _change_segments(rod, d, s, c0, old_s, dy, b, edge, w):
    """Write the residual b (N, 6) of the segments in direction s; edge (3,) is scratch."""
    for i in range(rod.length.shape[0]):
        r, u, l = w.frame[i], w.u[i], rod.length[i]
        for a in range(3):
            flexibility, vis = rod.flexibility[i, a], rod.strain_viscosity[i, a]
            even = 1 + flexibility * vis * c0
            rate = c0 * (w.g[i, a] / l - (a == 2)) + w.old_strain[i, a]
            stretch = (
                d.flexibility[s, i, a] * (u[a] - vis * w.old_strain[i, a]) / (even * even)
                - flexibility / even * (d.strain_viscosity[s, i, a] * rate + vis * old_s[i, a])
            )  # fmt: skip
            edge[a] = d.length[s, i] * w.g[i, a] / l + l * stretch
        b[i, 0] = -(edge[1] * u[2] - edge[2] * u[1])
        b[i, 1] = -(edge[2] * u[0] - edge[0] * u[2])
        b[i, 2] = -(edge[0] * u[1] - edge[1] * u[0])
        for a in range(3):
            b[i, 3 + a] = dy[i + 1, a] - dy[i, a]
            for c in range(3):
                b[i, 3 + a] -= r[a, c] * edge[c]


@inlined
def _change_bends(rod, d, s, t, c0, old_p, b, moment, block, w):
    """Add the residual of the bends and clamps in direction s; moment and block are scratch."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if not jointed(rod.stiffness, rod.bend_viscosity, j):
            continue
        pj = w.p[j]
        for a in range(3):
            rate = c0 * pj[a + 1] + w.old_p[j, a]
            moment[a] = (
                d.stiffness[s, j, a] * (pj[a + 1] - rod.rest[j, a + 1])
                - rod.stiffness[j, a] * d.rest[s, j, a]
                + d.bend_viscosity[s, j, a] * rate
                + rod.bend_viscosity[j, a] * old_p[j, a]
            )
        if j < n:
            across_back(pj, moment, 1.0, b[j, :3])
        if j > 0:
            across_back(pj, moment, -1.0, b[j - 1, :3])
        if j == 0:
            set_cross(pj, w.m[j], w.firm[j], block)
            for a in range(3):
                for c in range(3):
                    b[0, a] += block[c, a] * d.clamp[s, t, 0, c]
        if j == n:
            set_cross(pj, w.m[j], w.firm[j], block)
            for a in range(3):
                for c in range(3):
                    b[n - 1, a] += block[a, c] * d.clamp[s, t, 1, c]


@inlined
def _respond(b, dy, turn, dx, w):
    """Write turns (N, 3) and moves of the nodes dx (N+1, 3) from the solution b (N, 6)."""
    n = turn.shape[0]
    for i in range(n):
        for a in range(3):
            turn[i, a] = -b[i, a]
    for k in range(n + 1):
        for a in range(3):
            pull = 0.0
            if k < n:
                pull -= b[k, 3 + a]
            if k > 0:
                pull += b[k - 1, 3 + a]
            if w.body[k] < 0:
                dx[k, a] = dy[k, a] + w.inverse_mass[k] * pull
            else:
                for c in range(3):
                    dy[k, c] += w.inverse_mass[k] * w.out[k, c, a] * pull
        if w.body[k] >= 0:
            for a in range(3):
                dx[k, a] = dy[k, a]


@inlined
def _change_darboux(rod, d, s, t, p, turn, dp):
    """Write the change of the Darboux vectors dp (N+1, 3) by the turns beside them."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        out = dp[j]
        out[:] = 0.0
        if jointed(rod.stiffness, rod.bend_viscosity, j):
            before = d.clamp[s, t, 0] if j == 0 else turn[j - 1]
            after = d.clamp[s, t, 1] if j == n else turn[j]
            across(p[j], before, -1.0, out)
            across(p[j], after, 1.0, out)


@inlined
def _change_strains(rod, d, s, q, strain, turn, dx, block, ds):
    """Write the change of the strains ds (N, 3) by the turns, the nodes' moves and the lengths."""
    for i in range(rod.length.shape[0]):
        rotation(q[i], block)
        e, z, l = strain[i], turn[i], rod.length[i]
        e0, e1, e2 = e[0], e[1], e[2] + 1
        f = d.length[s, i] / l
        ds[i, 0] = e1 * z[2] - e2 * z[1] - f * e0
        ds[i, 1] = e2 * z[0] - e0 * z[2] - f * e1
        ds[i, 2] = e0 * z[1] - e1 * z[0] - f * e2
        for a in range(3):
            for c in range(3):
                gap = dx[i + 1, c] - dx[i, c]
                ds[i, a] += block[c, a] * gap / l
