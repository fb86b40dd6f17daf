"""Newton's method from a start to a stable equilibrium of one rope."""

from __future__ import annotations

import math

import numpy as np

from ropefit.solvers.equilibrium.kernels.block_tridiagonal import (
    factor_system,
    solve_columns,
)
from ropefit.solvers.equilibrium.kernels.hessian import assemble, set_corner
from ropefit.solvers.equilibrium.kernels.merit import curvature_along, end_work, merit
from ropefit.solvers.equilibrium.kernels.planar import solve_in_plane
from ropefit.solvers.equilibrium.kernels.small_matrices import solve_border
from ropefit.solvers.equilibrium.kernels.state import set_state, violations
from ropefit.solvers.kernels.jit import copy_rows, helper, inlined
from ropefit.solvers.kernels.rotations import turn_by
from ropefit.solvers.status import Status

CONVERGED, LIMIT, STUCK = int(Status.CONVERGED), int(Status.LIMIT), int(Status.STUCK)
NOT_FINITE, UNSTABLE = int(Status.NOT_FINITE), int(Status.UNSTABLE)
TURN_LIMIT = 1.2  # rad: largest turn of a segment in one step
REACH = 1e-5  # rad: a last full step below it leaves an error of its square
# Of the largest entry of the Hessian: what a rope is indifferent to (a buckled strut may turn about
# the line through its ends) has an eigenvalue of either sign in rounding.
NEUTRAL = 1e-9
HALVINGS = 40  # of a step, before it is given up
NEARLY_BALANCED = 1e-3  # of the largest moment: a residual below it may be that of such a state


@helper
def solve_rope(rod, held, q, lam, x0, tolerance, limit, w):
    """Solve by Newton from q, λ, x_0 (changed in place).

    Returns status, iterations, residual. The step is that of sequential quadratic programming: the
    Hessian is shifted until the energy is convex along the supports, and the step shortened until
    the augmented Lagrangian decreases.
    """
    count, whole = held.node.shape[0], 0.0
    for i in range(rod.length.shape[0]):
        whole += rod.length[i]
    shift, kicks = 0.0, 0
    done, last_step = solve_in_plane(rod, held, q, lam, x0, tolerance, limit, REACH, w)
    worst, known, energy = np.inf, False, 0.0
    for iteration in range(done, limit):
        if not known:
            energy = set_state(rod, held, q, lam, x0, w)
        known = False
        worst = _imbalance(rod, held, lam, whole, w)
        if not math.isfinite(worst):
            return NOT_FINITE, iteration, worst
        set_corner(rod, held, w)
        descent, used, size = _factor_near(rod, held, worst, w)
        if worst < tolerance and (last_step < REACH or worst < 1e-3 * tolerance):
            if descent <= 0:
                return CONVERGED, iteration, worst
            if kicks == 3:
                return UNSTABLE, iteration, worst
            kicks += 1
            last_step = np.inf
            _kick(rod, held, q, w)
            continue
        if descent > 0:
            used = _make_convex(rod, held, used, size, shift, w)
            shift = 0.0 if worst < NEARLY_BALANCED else used
        if not _solve_saddle(w):
            return STUCK, iteration, worst
        largest = _turns(w)
        if not math.isfinite(largest):
            return NOT_FINITE, iteration, worst
        if largest < 1e-3 and used <= NEUTRAL * size:
            _step(held, q, lam, x0, w)
            last_step = largest
            continue
        for s in range(count):
            w.trial_lam[s] = lam[s] + w.right[s, 0]
        share = 1.0 if largest < TURN_LIMIT else TURN_LIMIT / largest
        curvature = curvature_along(w, used)
        start, slope, weight, noise = merit(held, energy, curvature, whole, w)
        push = end_work(rod, w)
        if held.axial.shape[0] > 0:  # L is not quadratic in the forces then
            start = set_state(rod, held, q, w.trial_lam, x0, w)
            start += 0.5 * weight * violations(rod, held, w.trial_lam, w, w.gaps)
        for _ in range(HALVINGS):
            for i in range(q.shape[0]):
                turn_by(q[i], w.turn[i], share, w.trial[i])
            for a in range(3):
                w.trial_x[a] = x0[a] + share * w.right[count + a, 0]
            energy = set_state(rod, held, w.trial, w.trial_lam, w.trial_x, w)
            square = violations(rod, held, w.trial_lam, w, w.gaps)
            value = energy - share * push + 0.5 * weight * square
            known = value <= start + 1e-4 * share * min(slope, 0.0) + noise
            if known:
                break
            share *= 0.5
        if not known:
            if used > NEUTRAL * size and shift < 1e12:
                shift = 16 * used
                continue
            return STUCK, iteration, worst
        last_step = largest if share == 1.0 and used <= NEUTRAL * size else np.inf
        copy_rows(w.trial, q)
        for a in range(3):
            x0[a] = w.trial_x[a]
        for s in range(count):
            lam[s] += share * w.right[s, 0]
        known = share == 1.0  # the last state tried is the next one
    return LIMIT, limit, worst


@inlined
def _imbalance(rod, held, lam, whole, w):
    """Assemble the system; returns how far the state is from balance: the largest of moments,
    supports and, where nothing holds node 0, the total force, each relative to its own scale."""
    scale, residual = assemble(rod, held, lam, w)
    gap = math.sqrt(violations(rod, held, lam, w, w.rest))
    push, bear = 0.0, 0.0
    if held.free:
        count = held.node.shape[0]
        for a in range(3):
            push = max(push, abs(w.rest[count + a]))
        for k in range(rod.load.shape[0]):
            bear += abs(rod.load[k, 0]) + abs(rod.load[k, 1]) + abs(rod.load[k, 2])
    return max(residual / max(scale, 1e-300), gap / whole, push / max(bear, 1e-300))


@inlined
def _factor_near(rod, held, worst, w):
    """Factor and solve; near an equilibrium what is neutral may have either sign in rounding.

    Returns how many directions of descent are left, what was added to the diagonal, and the
    diagonal's largest entry (0 where no direction descends).
    """
    descent = factor_system(rod, held, w, 0.0, 0.0)
    used, size = 0.0, 0.0
    if descent > 0:
        size = _largest_entry(w)
        if worst < NEARLY_BALANCED:
            used = NEUTRAL * size
            descent = factor_system(rod, held, w, used, 0.0)
    return descent, used, size


@helper
def _largest_entry(w):
    """Return the largest entry [N m] on the Hessian's diagonal."""
    size = 0.0
    for i in range(w.diagonal.shape[0]):
        for a in range(3):
            size = max(size, abs(w.diagonal[i, a, a]))
    return size


@inlined
def _make_convex(rod, held, used, size, shift, w):
    """Shift the Hessian until the energy is convex along the supports; returns the shift."""
    # Near an equilibrium no more than needed, or what costs next to nothing to turn would
    # be turned slowly.
    used = 16 * used if used > 0 and shift == 0 else max(1e-4 * size, shift / 4)
    tries = 0
    while factor_system(rod, held, w, used, 0.0) > 0 and tries < 20:
        used *= 4
        tries += 1
    return used


@inlined
def _solve_saddle(w):
    """Write the changes of λ and x_0 into `right`; returns False when singular."""
    count, right = w.right.shape[0] - 3, w.right
    for s in range(count + 3):
        total = -w.rest[s]
        if s < count:
            for i in range(w.border.shape[0]):
                for a in range(3):
                    total += w.border[i, a, s] * w.solved[i, a, count]
        right[s, 0] = total
    return solve_border(w.schur, right, w.small)


@inlined
def _turns(w):
    """Write the turns of the segments (N, 3); returns the largest."""
    count = w.right.shape[0] - 3
    largest = 0.0
    for i in range(w.turn.shape[0]):
        size = 0.0
        for a in range(3):
            t = -w.solved[i, a, count]
            for s in range(count):
                t -= w.solved[i, a, s] * w.right[s, 0]
            w.turn[i, a] = t
            size += t * t
        largest = max(largest, size)
    return math.sqrt(largest)


@helper
def _step(held, q, lam, x0, w):
    """Move the state along a whole step."""
    count = held.node.shape[0]
    for i in range(q.shape[0]):
        turn_by(q[i], w.turn[i], 1.0, q[i])
    for s in range(count):
        lam[s] += w.right[s, 0]
    for a in range(3):
        if held.free:
            x0[a] += w.right[count + a, 0]


@helper
def _kick(rod, held, q, w):
    """Leave an unstable equilibrium along its steepest descent: inverse iteration on the Hessian,
    shifted just so far that it is convex."""
    n, count = rod.length.shape[0], held.node.shape[0]
    size = _largest_entry(w)
    mass = 1e-8 * size / rod.length[0]
    while factor_system(rod, held, w, 0.0, mass) > 0 and mass < 1e6 * size / rod.length[0]:
        mass *= 2
    vector, right = w.turn, w.right
    for i in range(n):
        for a in range(3):
            vector[i, a] = math.sin(1.7 * i + 2.3 * a + 0.5)
    for _ in range(12):
        for i in range(n):
            for a in range(3):
                w.border[i, a, count] = rod.length[i] * vector[i, a]
        solve_columns(w, count + 1, False)
        for s in range(count + 3):
            right[s, 0] = 0.0
            if s < count:
                for i in range(n):
                    for a in range(3):
                        right[s, 0] -= w.border[i, a, s] * w.solved[i, a, count]
        solve_border(w.schur, right, w.small)
        largest = 0.0
        for i in range(n):
            for a in range(3):
                t = w.solved[i, a, count]
                for s in range(count):
                    t -= w.solved[i, a, s] * right[s, 0]
                vector[i, a] = t
                largest = max(largest, abs(t))
        for i in range(n):
            for a in range(3):
                vector[i, a] /= largest
    for i in range(n):
        turn_by(q[i], vector[i], 0.1, q[i])
