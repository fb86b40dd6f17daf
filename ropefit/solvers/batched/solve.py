"""The equilibria of many ropes at once, for accelerators: Newton's method on all of them together.

The same energy, steps, line search and stopping rule as the compiled path, which remains the faster
one on a CPU. What does not arrive here (saddles to be left, singular systems, slow ropes) is
finished by the compiled path from the same start, so the answers are the same.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.rod import Rod
from ropefit.solvers.batched.ropes import (
    Factor,
    Hessian,
    Ropes,
    bent,
    descents,
    factor,
    hessian,
    imbalance,
    lagrangian,
    ropes_of,
    saddle,
    turned,
)
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.kernels import newton
from ropefit.solvers.equilibrium.problem import problem_of
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.solve import TOLERANCE, solve
from ropefit.solvers.equilibrium.start import starting
from ropefit.solvers.status import Status

STEPS = 40  # Newton steps of the batch; what takes longer is left to the compiled path
HALVINGS = 40
Fields = TypeVar("Fields", Ropes, Hessian, Factor)


def solve_batched(
    rod: Rod,
    conditions: Conditions,
    device: torch.device | str,
    start: States | None = None,
    member: np.ndarray | None = None,
) -> Solution:
    """Find equilibria like `equilibrium.solve`, with the work done on `device`."""
    rod, conditions = rod.in_numpy(), conditions.in_numpy()
    problem = problem_of(rod, conditions, member)
    ropes = ropes_of(problem, torch.device(device))
    first = starting(problem, conditions, start)
    q, lam, x0 = (torch.tensor(a, device=device) for a in first)
    with torch.no_grad():
        how = _newton(ropes, q, lam, x0)
        s = bent(ropes, q, lam, x0)
    arrays = (t.cpu().numpy() for t in (q, s.x, x0, lam, s.force, *how))
    found = Solution(*arrays, rod=rod, conditions=conditions, member=member)
    left = np.flatnonzero(~found.converged)
    if len(left):
        again = None if start is None else start.frames(left)
        of = problem.of[left]
        found.put(left, solve(rod, conditions.frames(left), again, of))
    return found


def some(fields: Fields, index: Tensor) -> Fields:
    """Return some of the ropes."""
    return type(fields)(*(item[index] for item in fields))


def _newton(ropes: Ropes, q: Tensor, lam: Tensor, x0: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Move q (B, N, 4), lam (B, S), x0 (B, 3) in place to equilibria; returns status, iterations
    and residual (B,)."""
    count, like = len(q), {"dtype": torch.int64, "device": q.device}
    status, iterations = torch.full((count,), int(Status.LIMIT), **like), torch.zeros(count, **like)
    worst = torch.full((count,), torch.inf, dtype=q.dtype, device=q.device)
    shift, last = torch.zeros_like(worst), torch.full_like(worst, torch.inf)
    whole = ropes.length.sum(1)
    bear = ropes.load.abs().sum((1, 2)).clamp_min(1e-300)
    index = torch.arange(count, device=q.device)
    for _ in range(STEPS):
        r = some(ropes, index)
        s = bent(r, q[index], lam[index], x0[index])
        moments, gaps = imbalance(r, lam[index], x0[index], s)
        h, largest = hessian(r, s)
        off = moments.abs().amax((1, 2)) / largest.clamp_min(1e-300)
        miss = torch.linalg.norm(gaps[:, :-3], dim=1) / whole[index]
        push = gaps[:, -3:].abs().amax(1) / bear[index]
        now = torch.stack([off, miss, push]).amax(0)
        worst[index] = now
        size = h.diagonal.diagonal(dim1=-2, dim2=-1).abs().amax((1, 2))
        f, used, descent = _factor_near(r, h, now, size)
        arrived = (now < TOLERANCE) & ((last[index] < newton.REACH) | (now < 1e-3 * TOLERANCE))
        broken = ~torch.isfinite(now)
        status[index[arrived]] = torch.where(
            descent[arrived] > 0, int(Status.UNSTABLE), int(Status.CONVERGED)
        )
        status[index[broken]] = int(Status.NOT_FINITE)
        go = torch.nonzero(~arrived & ~broken)[:, 0]
        if not len(go):
            break
        r, h, f = some(r, go), some(h, go), some(f, go)
        index, now, used, size, descent = (t[go] for t in (index, now, used, size, descent))
        used = _convex(r, h, f, used, size, descent, shift[index])
        shift[index] = torch.where(
            descent > 0, torch.where(now < newton.NEARLY_BALANCED, 0.0, used), shift[index]
        )
        turn, change = saddle(f, -moments[go], -gaps[go])
        stuck = _step(r, h, (q, lam, x0, shift, last), index, turn, change, used, size)
        iterations[index] += 1
        status[index[stuck]] = int(Status.STUCK)
        index = index[~stuck]
        if not len(index):
            break
    return status, iterations, worst


def _factor_near(
    r: Ropes, h: Hessian, worst: Tensor, size: Tensor
) -> tuple[Factor, Tensor, Tensor]:
    """Return the factor, what was added to the diagonal (B,) and the directions of descent left.

    Near an equilibrium, what is neutral may have either sign in rounding.
    """
    used = torch.zeros_like(worst)
    f = factor(h, used)
    descent = descents(r, f)
    near = torch.nonzero((descent > 0) & (worst < newton.NEARLY_BALANCED))[:, 0]
    if len(near):
        used[near] = newton.NEUTRAL * size[near]
        descent[near] = _refactor(r, h, f, near, used)
    return f, used, descent


def _refactor(r: Ropes, h: Hessian, f: Factor, index: Tensor, used: Tensor) -> Tensor:
    """Factor some of the ropes anew, in place; return their directions of descent."""
    again = factor(some(h, index), used[index])
    for old, new in zip(f, again, strict=True):
        old[index] = new
    return descents(some(r, index), again)


def _convex(
    r: Ropes, h: Hessian, f: Factor, used: Tensor, size: Tensor, descent: Tensor, shift: Tensor
) -> Tensor:
    """Make the energy convex along the supports, f in place; returns what was added (B,)."""
    more = torch.maximum(1e-4 * size, shift / 4)
    more = torch.where((used > 0) & (shift == 0), 16 * used, more)
    used = torch.where(descent > 0, more, used)
    index = torch.nonzero(descent > 0)[:, 0]
    for _ in range(21):
        if not len(index):
            break
        index = index[_refactor(r, h, f, index, used) > 0]
        used[index] *= 4
    return used


def _step(
    r: Ropes, h: Hessian, state: tuple[Tensor, ...], index: Tensor, turn: Tensor, change: Tensor,
    used: Tensor, size: Tensor,
) -> Tensor:  # fmt: skip
    """Move the ropes `index` of the state along a step, by a line search on the augmented
    Lagrangian at the new forces; returns which found no step (B,)."""
    q, lam, x0, shift, last = state
    q_now, x_now = q[index], x0[index]
    new = lam[index] + change[:, :-3]
    aside = torch.where(r.free[:, None], change[:, -3:], 0.0)
    largest = torch.linalg.norm(turn, dim=-1).amax(1)
    share = (newton.TURN_LIMIT / largest).clamp_max(1.0)
    neutral = used <= newton.NEUTRAL * size
    small = (largest < 1e-3) & neutral

    s = bent(r, q_now, new, x_now)
    value = lagrangian(r, new, x_now, s)
    square = (imbalance(r, new, x_now, s)[1][:, :-3] ** 2).sum(1)
    tension, whole = s.force.abs().amax((1, 2)), r.length.sum(1)
    curved = (h.diagonal @ turn[..., None])[..., 0] + used[:, None, None] * turn
    curved[:, :-1] += 2 * (h.off @ turn[:, 1:, :, None])[..., 0]
    curvature = (curved * turn).sum((1, 2))
    weight = 10 * tension / whole
    enough = torch.minimum(-4 * curvature / square, 1e4 * tension / whole)
    raise_it = (square > 0) & (curvature < 0.5 * weight * square)
    weight = torch.where(raise_it, torch.maximum(weight, enough), weight)
    slope = -curvature - weight * square
    value = value + 0.5 * weight * square
    push = sum(
        ((s.frame[:, i].mT @ r.moment[:, i, :, None])[..., 0] * turn[:, i]).sum(1) for i in (0, -1)
    )
    noise = 1e-13 * (value.abs() + tension * whole)

    def allowed(rows: Tensor) -> Tensor:
        p, x, part = some(r, rows), x_now[rows] + share[rows, None] * aside[rows], share[rows]
        tried = bent(p, turned(q_now[rows], part[:, None, None] * turn[rows]), new[rows], x)
        there = lagrangian(p, new[rows], x, tried) - part * push[rows]  # pyright: ignore[reportIndexIssue]
        _, short = imbalance(p, new[rows], x, tried)
        gap = short[:, :-3]
        there = there + 0.5 * weight[rows] * (gap**2).sum(1)
        return there <= value[rows] + 1e-4 * part * slope[rows].clamp_max(0.0) + noise[rows]

    waiting = torch.nonzero(~small)[:, 0]
    for _ in range(HALVINGS):
        if not len(waiting):
            break
        waiting = waiting[~allowed(waiting)]
        share[waiting] *= 0.5
    moved = torch.ones_like(small)
    moved[waiting] = False
    go, part = index[moved], share[moved]
    q[go] = turned(q_now[moved], part[:, None, None] * turn[moved])
    lam[go] += part[:, None] * change[moved, :-3]
    x0[go] += part[:, None] * aside[moved]
    quick = small[moved] | ((part == 1.0) & neutral[moved])
    last[go] = torch.where(quick, largest[moved], torch.inf)
    # What found no step was not convex enough; or nothing lowers its energy.
    firmer = ~moved & (used > newton.NEUTRAL * size) & (shift[index] < 1e12)
    shift[index[firmer]] = 16 * used[firmer]
    return ~moved & ~firmer
