"""One clip step by step: Newton's method on each."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ropefit.solvers.dynamics.kernels.block_tridiagonal import factor, solve_system
from ropefit.solvers.dynamics.kernels.contact import set_rates
from ropefit.solvers.dynamics.kernels.drag import set_resistance
from ropefit.solvers.dynamics.kernels.rates import (
    rates,
    set_bends,
    set_nodes_past,
    set_past,
    set_strains,
    step_ratio,
)
from ropefit.solvers.dynamics.kernels.records import Work, make_work, work_of
from ropefit.solvers.dynamics.kernels.system import assemble, prepare, set_nodes
from ropefit.solvers.kernels.jit import copy_rows, helper, maker
from ropefit.solvers.kernels.rotations import turn_by
from ropefit.solvers.status import Status

CONVERGED, LIMIT, NOT_FINITE = int(Status.CONVERGED), int(Status.LIMIT), int(Status.NOT_FINITE)
TURN_LIMIT = 0.5  # rad: largest turn of a segment in one iteration
SPIN_LIMIT = 0.05  # rad: the same of a spin that only damping resists
PATIENCE = 12  # iterations of full length, then as many of half, ...
REACH = 1e-6  # rad, and relative in force: a step below it leaves an error of its square


@helper
def _predict(qs, forces, t, q, force):
    """Start of the iterations: as the last step went on."""
    n = q.shape[0]
    for i in range(n):
        if t == 1:
            for k in range(4):
                q[i, k] = qs[0, i, k]
            for k in range(3):
                force[i, k] = forces[0, i, k]
            continue
        a, b = qs[t - 2, i], qs[t - 1, i]
        s = 2 * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
        size = 0.0
        for k in range(4):  # b a* b, the turn from a to b once more
            q[i, k] = s * b[k] - a[k]
            size += q[i, k] * q[i, k]
        size = 1.0 / math.sqrt(size)
        for k in range(4):
            q[i, k] *= size
        for k in range(3):
            force[i, k] = forces[t - 1, i, k]


@helper
def newton_step(rod, drive, t, c0, q, force, w, half, limit):
    """Take one step by Newton's method, from q and force on. Returns (status, iterations)."""
    n = rod.length.shape[0]
    most = math.inf  # largest spin of all segments alike in one iteration
    if rod.gauge > 0.0:
        most = SPIN_LIMIT if rod.bend_viscosity.any() else 0.0
    weight = 0.0  # of a node: forces that count, also in a rope that flies freely and bears none
    for k in range(n + 1):
        for a in range(3):
            weight = max(weight, abs(rod.load[k, a]))
    for iteration in range(limit):
        assemble(rod, drive, t, c0, q, force, w)
        factor(w, half)
        solve_system(w, w.right, half[0])
        turn, change, largest = 0.0, 0.0, weight
        # A spin of all segments alike costs nothing here, or next to nothing; away from the
        # solution the matrix knows little of it, and the next step would take it for motion.
        spin = w.right[0, 2] - max(-most, min(most, w.right[0, 2]))
        for i in range(n):
            w.right[i, 2] -= spin
            for a in range(3):
                turn = max(turn, abs(w.right[i, a]))
                change = max(change, abs(w.right[i, 3 + a]))
                largest = max(largest, abs(force[i, a]))
        if not (math.isfinite(turn) and math.isfinite(change)):
            return NOT_FINITE, iteration
        done = turn < REACH and change < REACH * (largest + change) + 1e-300
        # A step that does not settle soon is one between two valleys: shorter steps get down one.
        # The last is taken whole: a part of it would leave an error of its size, not its square.
        longest = 1.0 if done or iteration < PATIENCE else 0.5 ** (iteration // PATIENCE)
        share = -min(longest, TURN_LIMIT / max(turn, 1e-300))
        for i in range(n):
            turn_by(q[i], w.right[i], share, q[i])
            for a in range(3):
                force[i, a] += share * w.right[i, 3 + a]
        if done:
            return CONVERGED, iteration + 1
    return LIMIT, limit


class Scratch(NamedTuple):
    """Scratch of one clip, and of its last three times speeds (3, N+1, 3), Darboux quaternions
    (3, N+1, 4) and strains (3, N, 3)."""

    work: Work
    half: np.ndarray
    v: np.ndarray
    p: np.ndarray
    strain: np.ndarray


@maker
def make_scratch(n):
    """Return scratch for n segments."""
    return Scratch(
        make_work(n), np.zeros((6, 6)), np.zeros((3, n + 1, 3)), np.zeros((3, n + 1, 4)),
        np.zeros((3, n, 3)),
    )  # fmt: skip


@maker
def scratch_of(s, k):
    """Return the scratch of clip k of C."""
    return Scratch(work_of(s.work, k), s.half[k], s.v[k], s.p[k], s.strain[k])


@helper
def simulate_clip(rod, drive, v0, limit, xs, qs, forces, iterations, scratch):
    """Simulate one clip. xs, qs, forces hold the first state and receive the others. Returns the
    status and the number of steps done."""
    steps = qs.shape[0]
    w, half, v, p, strain = scratch
    copy_rows(v0, v[0])
    set_bends(rod, drive.clamp[0], qs[0], p[0])
    set_strains(rod, xs[0], qs[0], half[:3, :3], strain[0])
    for t in range(1, steps):
        c0, c1, c2 = rates(drive.time, t)
        now, one, two = t % 3, (t - 1) % 3, (t - 2) % 3
        set_rates(rod, drive.time, xs, t, w.rate)
        set_nodes_past(w.rate, xs[t - 1], xs[max(t - 2, 0)], w.old_x)
        set_nodes_past(w.rate, v[one], v[two], w.old_v)
        set_past(c1, c2, p[one, :, 1:], p[two, :, 1:], w.old_p)
        set_past(c1, c2, strain[one], strain[two], w.old_strain)
        _predict(qs, forces, t, qs[t], forces[t])
        set_resistance(rod, step_ratio(drive.time, t), v[one], v[two], w)
        prepare(rod, drive, t, c0, w)
        status, count = newton_step(rod, drive, t, c0, qs[t], forces[t], w, half, limit)
        iterations[t] = count
        if status != CONVERGED:
            return status, t
        set_nodes(rod, forces[t], w)
        copy_rows(w.x, xs[t])
        for k in range(rod.mass.shape[0]):
            for a in range(3):
                v[now, k, a] = w.rate[k, 0] * xs[t, k, a] + w.old_x[k, a]
        set_bends(rod, drive.clamp[t], qs[t], p[now])
        set_strains(rod, xs[t], qs[t], half[:3, :3], strain[now])
    return CONVERGED, steps
