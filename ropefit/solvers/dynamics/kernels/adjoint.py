"""Gradients of a loss of a clip in everything that decides it, backward in time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.solvers.dynamics.kernels.block_tridiagonal import solve_system
from ropefit.solvers.dynamics.kernels.contact import leave_bodies
from ropefit.solvers.dynamics.kernels.histories import (
    Histories,
    histories_of,
    make_histories,
    set_histories,
)
from ropefit.solvers.dynamics.kernels.rates import (
    across,
    across_back,
    jointed,
    rates,
    step_ratio,
)
from ropefit.solvers.dynamics.kernels.records import Work, make_work, work_of
from ropefit.solvers.dynamics.kernels.system import settled
from ropefit.solvers.kernels.bends import set_cross
from ropefit.solvers.kernels.jit import copy_rows, helper, inlined, maker
from ropefit.solvers.kernels.rotations import rotation


class Pullback(NamedTuple):
    """Scratch of one clip: histories, and gradients in speeds, Darboux vectors (T, N+1, 3) and
    strains (T, N, 3) of all times."""

    work: Work
    half: np.ndarray
    past: Histories
    gv: np.ndarray
    gp: np.ndarray
    gs: np.ndarray
    b: np.ndarray
    block: np.ndarray
    mu: np.ndarray
    pulled: np.ndarray


@maker
def make_pullback(steps, n):
    """Return scratch for T times of n segments; gradients are zero."""
    return Pullback(
        make_work(n), np.zeros((6, 6)), make_histories(steps, n), np.zeros((steps, n + 1, 3)),
        np.zeros((steps, n + 1, 3)), np.zeros((steps, n, 3)), np.zeros((n, 6)), np.zeros((3, 3)),
        np.zeros(3), np.zeros((n + 1, 3)),
    )  # fmt: skip


@maker
def pullback_of(s, k):
    """Return the scratch of clip k of C."""
    return Pullback(
        work_of(s.work, k), s.half[k], histories_of(s.past, k), s.gv[k], s.gp[k], s.gs[k], s.b[k],
        s.block[k], s.mu[k], s.pulled[k],
    )  # fmt: skip


@helper
def adjoint_clip(rod, drive, v0, xs, qs, forces, gx, gq, out, scratch):
    """Pull gradients gx (T, N+1, 3) and gq (T, N, 3), in turns, back into `out`, a `Change`.

    gx and gq are used up.
    """
    steps, n = qs.shape[0], qs.shape[1]
    w, half, past, gv, gp, gs, b, block, mu, pulled = scratch
    set_histories(rod, drive, xs, qs, v0, past)
    v, p, strain = past.v, past.p, past.strain
    for t in range(steps - 1, -1, -1):
        c0, c1, c2 = rates(drive.time, max(t, 1))
        two = max(t - 2, 0)
        _pull_strains(rod, qs[t], gs[t], strain[t], gq[t], gx[t], out, block)
        _pull_darboux(rod, t, p[t], gp[t], gq[t], out)
        if t == 0:
            break
        settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w)
        for k in range(n + 1):  # v of this time
            for a in range(3):
                gx[t, k, a] += w.rate[k, 0] * gv[t, k, a]
                gx[t - 1, k, a] += w.rate[k, 1] * gv[t, k, a]
                gx[two, k, a] += w.rate[k, 2] * gv[t, k, a]
        for i in range(n):
            for a in range(3):
                b[i, a] = -gq[t, i, a]
                b[i, 3 + a] = _given(w, i + 1, a, gx[t, i + 1]) - _given(w, i, a, gx[t, i])
        solve_system(w, b, half[0])
        for k in range(n + 1):
            for a in range(3):
                pulled[k, a] = _pulled(gx[t], b, k, a)
        leave_bodies(rod, w, pulled, out.bodies)
        _pull_nodes(rod, drive, t, pulled, gx, gv, out, w)
        _pull_drag(rod, drive, t, pulled, gv, out, w)
        _pull_segments(rod, t, (c0, c1, c2), b, gs, out, w)
        _pull_bends(rod, t, (c0, c1, c2), b, gp, out, mu, block, w)
    copy_rows(gx[0], out.x0)
    copy_rows(gv[0], out.v0)
    copy_rows(gq[0], out.q0)


@inlined
def _pull_strains(rod, q, gs, strain, gq, gx, out, block):
    """Pull the gradient in the strains of one time back to its frames, nodes and lengths."""
    for i in range(rod.length.shape[0]):
        rotation(q[i], block)
        s, e, l = gs[i], strain[i], rod.length[i]
        e0, e1, e2 = e[0], e[1], e[2] + 1
        gq[i, 0] += s[1] * e2 - s[2] * e1
        gq[i, 1] += s[2] * e0 - s[0] * e2
        gq[i, 2] += s[0] * e1 - s[1] * e0
        out.length[i] -= (s[0] * e0 + s[1] * e1 + s[2] * e2) / l
        for c in range(3):
            total = (block[c, 0] * s[0] + block[c, 1] * s[1] + block[c, 2] * s[2]) / l
            gx[i + 1, c] += total
            gx[i, c] -= total


@inlined
def _pull_darboux(rod, t, p, gp, gq, out):
    """Pull the gradient in the Darboux vectors of one time back to its frames and clamps."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if jointed(rod.stiffness, rod.bend_viscosity, j):
            before = out.clamp[t, 0] if j == 0 else gq[j - 1]
            after = out.clamp[t, 1] if j == n else gq[j]
            across_back(p[j], gp[j], -1.0, before)
            across_back(p[j], gp[j], 1.0, after)


@inlined
def _pull_nodes(rod, drive, t, pulled, gx, gv, out, w):
    """Pull the gradient in the nodes of time t without bodies back to ends, loads, masses, air and
    the past."""
    n, two = rod.length.shape[0], max(t - 2, 0)
    for k in range(n + 1):
        end, c = 0 if k == 0 else 1, w.rate[k]
        fixed = (k == 0 or k == n) and drive.held[end]
        for a in range(3):
            total = pulled[k, a]
            if fixed:
                out.ends[t, end, a] += total
                continue
            s = w.inverse_mass[k] * total
            out.load[k, a] += s
            v = c[0] * w.z[k, a] + w.old_x[k, a]
            out.mass[k] -= s * (c[0] * v + w.old_v[k, a])
            out.spring[k] -= s * w.z[k, a]
            out.air[k] -= s * w.drag[k, 0] * v
            drag = (rod.mass[k] * c[0] + w.air[k]) * s
            gx[t - 1, k, a] -= c[1] * drag
            gx[two, k, a] -= c[2] * drag
            gv[t - 1, k, a] -= c[1] * rod.mass[k] * s
            gv[two, k, a] -= c[2] * rod.mass[k] * s


@inlined
def _given(w, k, a, g):
    """Return how far node k gives along axis a to a force g (3,)."""
    give, out = w.inverse_mass[k], w.out[k, a]
    return give * (g[a] if w.body[k] < 0 else out[0] * g[0] + out[1] * g[1] + out[2] * g[2])


@inlined
def _pulled(gx, b, k, a):
    """Return the gradient in one coordinate of a node, what the solution b (N, 6) adds included."""
    total = gx[k, a]
    if k < b.shape[0]:
        total -= b[k, 3 + a]
    if k > 0:
        total += b[k - 1, 3 + a]
    return total


@inlined
def _pull_drag(rod, drive, t, pulled, gv, out, w):
    """Pull the gradient in the nodes of time t back to the law of drag, and to the speeds before
    that it is taken at."""
    n, two, ratio = rod.length.shape[0], max(t - 2, 0), step_ratio(drive.time, t)
    for k in range(n + 1):
        end = 0 if k == 0 else 1
        if (k == 0 or k == n) and drive.held[end]:
            continue
        total = 0.0
        for a in range(3):
            v = w.rate[k, 0] * w.z[k, a] + w.old_x[k, a]
            total -= w.inverse_mass[k] * pulled[k, a] * w.air[k] * v
        knot, above = int(w.drag[k, 1]), w.drag[k, 2]
        out.drag[knot] += (1 - above) * total
        out.drag[knot + 1] += above * total
        for a in range(3):
            faster = total * w.drag[k, 3] * w.ahead[k, a]
            gv[t - 1, k, a] += (1 + ratio) * faster
            gv[two, k, a] -= ratio * faster


@inlined
def _pull_segments(rod, t, c, b, gs, out, w):
    """Pull the solution b (N, 6) of time t back to lengths, flexibilities, their viscosity and the
    strains of the past."""
    two = max(t - 2, 0)
    for i in range(rod.length.shape[0]):
        r, u, l = w.frame[i], w.u[i], rod.length[i]
        m0, m1, m2 = b[i, 0], b[i, 1], b[i, 2]
        p0, p1, p2 = u[1] * m2 - u[2] * m1, u[2] * m0 - u[0] * m2, u[0] * m1 - u[1] * m0
        for a in range(3):
            pull = (p0, p1, p2)[a]
            pull += r[0, a] * b[i, 3] + r[1, a] * b[i, 4] + r[2, a] * b[i, 5]
            flexibility, vis = rod.flexibility[i, a], rod.strain_viscosity[i, a]
            even = 1 + flexibility * vis * c[0]
            rate = c[0] * (w.g[i, a] / l - (a == 2)) + w.old_strain[i, a]
            g = -l * pull
            out.length[i] -= w.g[i, a] / l * pull
            out.flexibility[i, a] += g * (u[a] - vis * w.old_strain[i, a]) / (even * even)
            out.strain_viscosity[i, a] -= g * flexibility / even * rate
            gs[t - 1, i, a] -= c[1] * g * flexibility / even * vis
            gs[two, i, a] -= c[2] * g * flexibility / even * vis


@inlined
def _pull_bends(rod, t, c, b, gp, out, mu, block, w):
    """Pull the solution b (N, 6) of time t back to stiffness, its viscosity, rest shape, clamps and
    the Darboux vectors of the past."""
    n, two = rod.length.shape[0], max(t - 2, 0)
    for j in range(n + 1):
        if not jointed(rod.stiffness, rod.bend_viscosity, j):
            continue
        pj = w.p[j]
        mu[:] = 0.0
        if j > 0:
            across(pj, b[j - 1, :3], -1.0, mu)
        if j < n:
            across(pj, b[j, :3], 1.0, mu)
        for a in range(3):
            out.stiffness[j, a] += mu[a] * (pj[a + 1] - rod.rest[j, a + 1])
            out.bend_viscosity[j, a] += mu[a] * (c[0] * pj[a + 1] + w.old_p[j, a])
            out.rest[j, a] -= mu[a] * rod.stiffness[j, a]
            gp[t - 1, j, a] += c[1] * rod.bend_viscosity[j, a] * mu[a]
            gp[two, j, a] += c[2] * rod.bend_viscosity[j, a] * mu[a]
        if j == 0 or j == n:
            set_cross(pj, w.m[j], w.firm[j], block)
            for a in range(3):
                for k in range(3):
                    if j == 0:
                        out.clamp[t, 0, a] += block[a, k] * b[0, k]
                    else:
                        out.clamp[t, 1, a] += block[k, a] * b[n - 1, k]
