"""The rod in equilibrium, by Newton's method from catenaries or from known states.

`solve` finds the states, `stability.py` their smallest eigenvalue; `implicit.py` differentiates
them. The compiled work is in `kernels/`. What is given as tensors is found in a solution as arrays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.rod.rod import DIMS, Rod
from ropefit.solvers.arrays import in_threads
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.kernels.entries import solve_ropes
from ropefit.solvers.equilibrium.problem import Problem, cut, problem_of
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.start import starting
from ropefit.solvers.status import Status

TOLERANCE = 1e-10  # of the largest moment, and of the length
NEWTON_LIMIT = 200
# Stiffness to begin with where a catenary does not lead to the rope's own, times that; the largest
# and the smallest stride towards it, as factors.
EASIER, STRIDE, LEAST_STRIDE = (1e-3, 1e3), 10.0, 1.02


def solve(
    rod: Rod,
    conditions: Conditions,
    start: States | None = None,
    member: np.ndarray | None = None,
    turns: np.ndarray | None = None,
    tolerance: float = TOLERANCE,
    limit: int = NEWTON_LIMIT,
    continuation: bool = True,
    problem: Problem | None = None,
) -> Solution:
    """Find stable equilibria of F frames, each from the catenary through its ends or from `start`.

    Frames that the catenary does not lead to an equilibrium are tried again by continuation: from a
    softer or a stiffer rope, in strides, to the rope's own stiffness.

    member (F,): which of the rod's R ropes each frame shows (all the only one, or one each, if not
    given). turns (F,): whole turns of twist that a catenary start is given between two clamps.
    problem: of these very rod, conditions and member, if known.
    Never raises for a frame that does not converge: its status says so.
    """
    rod, conditions = rod.in_numpy(), conditions.in_numpy()
    problem = problem or problem_of(rod, conditions, member)
    q, lam, base = starting(problem, conditions, start, turns)
    x, force, status, iterations, residual = newton(problem, q, lam, base, tolerance, limit)
    found = Solution(q, x, base, lam, force, status, iterations, residual, rod, conditions, member)
    found.__dict__["problem"] = problem
    lost = ~found.converged & (status != Status.NOT_FINITE)
    if start is None and continuation and lost.any():
        _continue(rod, conditions, problem.of, turns, tolerance, limit, found, lost)
    return found


def newton(
    problem: Problem, q: np.ndarray, lam: np.ndarray, base: np.ndarray,
    tolerance: float = TOLERANCE, limit: int = NEWTON_LIMIT,
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """Find equilibria from frames q (F, N, 4), reactions lam (F, S) [N] and base (F, 3) [m], which
    are changed in place; return x (F, N+1, 3) [m], force (F, N, 3) [N], status, iterations and
    residual (F,)."""
    frames, segments = q.shape[:2]
    status, iterations = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    residual = np.empty(frames)
    x, force = np.empty((frames, segments + 1, 3)), np.empty((frames, segments, 3))

    def work(index: slice) -> None:
        solve_ropes(
            *cut(problem, index), q[index], lam[index], base[index], tolerance, limit,
            status[index], iterations[index], residual[index], x[index], force[index],
        )  # fmt: skip

    in_threads(work, frames)
    return x, force, status, iterations, residual


def _continue(
    rod: Rod,
    conditions: Conditions,
    of: np.ndarray,
    turns: np.ndarray | None,
    tolerance: float,
    limit: int,
    found: Solution,
    lost: np.ndarray,
) -> None:
    """Put equilibria that continuation in stiffness reaches into the `lost` frames (F,)."""
    stiffness = rod.stiffness if rod.stiffness.ndim == 3 else rod.stiffness[None]
    owner = of if len(stiffness) > 1 else np.zeros_like(of)
    fixed = Rod(*(t if t.ndim == d else t[of] for t, d in zip(rod, DIMS, strict=True)))

    def at(factor: np.ndarray, index: np.ndarray, start: States | None) -> Solution:
        """Return equilibria of some frames with their stiffness times factor (n,)."""
        few = Rod(*(t if t.ndim == d else t[index] for t, d in zip(fixed, DIMS, strict=True)))
        times = factor[:, None, None]
        held = conditions.frames(index)
        if held.friction_elements is not None:
            drag = held.friction_elements.drag * times
            held = replace(held, friction_elements=held.friction_elements._replace(drag=drag))
        return solve(
            few._replace(stiffness=stiffness[owner[index]] * times), held, start,
            turns=None if turns is None else turns[index], tolerance=tolerance, limit=limit,
            continuation=False,
        )  # fmt: skip

    for easier in EASIER:
        index = np.flatnonzero(lost & ~found.converged)
        if not len(index):
            return
        here = np.full(len(index), np.log(easier))
        stride = np.full(len(index), np.log(STRIDE))
        state = at(np.exp(here), index, None)
        keep = state.converged
        while keep.any():
            index, here, stride, state = index[keep], here[keep], stride[keep], state.frames(keep)
            ahead = np.sign(here) * np.maximum(np.abs(here) - stride, 0.0)
            there = at(np.exp(ahead), index, state)
            ok = there.converged
            state.put(ok, there, ok)
            here = np.where(ok, ahead, here)
            stride = np.where(ok, stride, 0.5 * stride)
            done = ok & (ahead == 0.0)
            found.put(index[done], there, done)
            keep = ~done & (stride > np.log(LEAST_STRIDE))
