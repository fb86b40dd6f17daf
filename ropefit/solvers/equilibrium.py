"""The rod in equilibrium, by Newton's method from catenaries or from known states.

`solve` finds the states, `stability` their smallest eigenvalue; `implicit.py` differentiates them.
The compiled work is in `newton_kernels.py`. All arrays float64 on the CPU.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
import torch

from ropefit.rod.rod import Rod
from ropefit.solvers import newton_kernels as kernels
from ropefit.solvers.conditions import Conditions, Problem, as_numpy, cut, in_threads, problem_of
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.start import start_ropes
from ropefit.solvers.turns import rolled

Index = int | np.integer | slice | np.ndarray
TOLERANCE = 1e-10  # of the largest moment, and of the length
LIMIT = 200
# Stiffness to begin with where a catenary does not lead to the rope's own, times that; the largest
# and the smallest stride towards it, as factors.
EASIER, STRIDE, LEAST_STRIDE = (1e-3, 1e3), 10.0, 1.02
ADVICE = {
    kernels.CONVERGED: "converged",
    kernels.LIMIT: "iteration limit reached; give more iterations or a nearer start",
    kernels.STUCK: "no step lowers the energy; are the ends farther apart than the rope is long?",
    kernels.NOT_FINITE: "not finite; look at the rod and its ends",
    kernels.UNSTABLE: "in equilibrium, but not stable",
}


@dataclass(frozen=True)
class States:
    """States of F frames to start a solve from, whatever they were solved under.

    q (F, N, 4), x (F, N+1, 3) [m], base (F, 3) [m] of node 0, reaction (F, E) [N] of the far end's
    supports: E is 3 where that end is held, else 0.
    """

    q: np.ndarray
    x: np.ndarray
    base: np.ndarray
    reaction: np.ndarray

    def frames(self, index: np.ndarray) -> States:
        """Return the states of some of the frames."""
        return States(*(getattr(self, name)[index] for name in _STATES))

    def copy(self) -> States:
        """Return states whose arrays may be changed."""
        return States(*(getattr(self, name).copy() for name in _STATES))

    def put(self, mine: Index, other: States, theirs: Index = slice(None)) -> None:
        """Replace frames `mine` by the frames `theirs` of other states."""
        for name in ("q", "x", "base"):
            getattr(self, name)[mine] = getattr(other, name)[theirs]
        known = self.reaction.shape[1]
        self.reaction[mine] = other.reaction[theirs][..., :known]


_STATES = tuple(field.name for field in fields(States))


@dataclass(frozen=True)
class Solution(States):
    """States of F frames, the rod and the conditions that they were solved under, and how it went.

    reaction (F, S) [N] of all supports, the far end's first; force (F, N, 3) [N] in the segments;
    status (F,) see ADVICE, iterations (F,), residual (F,); member (F,): which of the rod's R ropes
    each frame shows. Derivatives and stability are computed from a solution alone, so that no state
    meets conditions which are not its own. Raises ShapeError where the arrays do not belong
    together.
    """

    force: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    residual: np.ndarray
    rod: Rod = field(repr=False)
    conditions: Conditions = field(repr=False)
    member: np.ndarray | None = field(repr=False, default=None)

    def __post_init__(self) -> None:
        frames, segments = len(self.conditions.ends), self.rod.length.shape[-1]
        supports = self.conditions.supports
        check_shapes(
            q=(self.q, (frames, segments, 4)),
            x=(self.x, (frames, segments + 1, 3)),
            base=(self.base, (frames, 3)),
            reaction=(self.reaction, (frames, supports)),
            force=(self.force, (frames, segments, 3)),
            status=(self.status, (frames,)),
            iterations=(self.iterations, (frames,)),
            residual=(self.residual, (frames,)),
        )

    @cached_property
    def problem(self) -> Problem:
        """Return the rod and the conditions as the compiled solver takes them."""
        return problem_of(self.rod, self.conditions, self.member)

    @property
    def converged(self) -> np.ndarray:
        """(F,) bool."""
        return self.status == kernels.CONVERGED

    @property
    def states(self) -> States:
        """Return a copy of the states alone, to start another solve from."""
        ends = self.conditions.far_supports
        return States(
            self.q.copy(), self.x.copy(), self.base.copy(), self.reaction[:, :ends].copy()
        )

    def frames(self, index: np.ndarray) -> Solution:
        """Return the solution of some of the frames."""
        index = np.atleast_1d(np.arange(len(self.q))[index])
        arrays = {name: getattr(self, name)[index] for name in ARRAYS}
        member = None if self.member is None else self.member[index]
        rod = self.rod if member is not None else self.rod.frames(index)
        return Solution(**arrays, rod=rod, conditions=self.conditions.frames(index), member=member)

    def put(self, mine: Index, other: Solution, theirs: Index = slice(None)) -> None:
        """Replace frames `mine` by the frames `theirs` of another solution of the same frames.

        Raises ValueError where the two were not held by the same supports.
        """
        if not _same(self.conditions.node, other.conditions.node):
            raise ValueError("the solutions were not held by the same supports")
        for name in ARRAYS:
            getattr(self, name)[mine] = getattr(other, name)[theirs]

    def unsettle(self, mine: Index, states: States) -> None:
        """Put frames `mine` back to their states in `states`, marked as not converged."""
        ends = self.conditions.far_supports
        for name in ("q", "x", "base"):
            getattr(self, name)[mine] = getattr(states, name)[mine]
        self.reaction[mine] = 0.0
        self.reaction[mine, :ends] = states.reaction[mine, :ends]
        self.force[mine], self.status[mine] = 0.0, kernels.LIMIT

    def copy(self) -> Solution:
        """Return a solution whose arrays may be changed."""
        return replace(self, **{name: getattr(self, name).copy() for name in ARRAYS})


# Of a solution: its arrays, frame by frame.
ARRAYS = (*_STATES, "force", "status", "iterations", "residual")


def unsettled(rod: Rod, conditions: Conditions, states: States) -> Solution:
    """Return states as a solution in which no frame has converged."""
    frames, segments = states.q.shape[:2]
    reaction = np.zeros((frames, conditions.supports))
    ends = conditions.far_supports  # states may be those of a solution with more supports
    reaction[:, :ends] = states.reaction[:, :ends]
    return Solution(
        states.q.copy(), states.x.copy(), states.base.copy(), reaction,
        np.zeros((frames, segments, 3)), np.full(frames, kernels.LIMIT),
        np.zeros(frames, dtype=np.int64), np.full(frames, np.inf), rod, conditions,
    )  # fmt: skip


def _same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    """Return whether two solutions have the same nodes supported."""
    none = np.empty(0, dtype=np.int64)
    return np.array_equal(none if a is None else a, none if b is None else b)


def solve(
    rod: Rod,
    conditions: Conditions,
    start: States | None = None,
    member: np.ndarray | None = None,
    turns: np.ndarray | None = None,
    tolerance: float = TOLERANCE,
    limit: int = LIMIT,
    continuation: bool = True,
    problem: Problem | None = None,
) -> Solution:
    """Stable equilibria of F frames, each from the catenary through its ends or from `start`.

    Frames that the catenary does not lead to an equilibrium are tried again by continuation: from a
    softer or a stiffer rope, in strides, to the rope's own stiffness.

    member (F,): which of the rod's R ropes each frame shows (all the only one, or one each, if not
    given). turns (F,): whole turns of twist that a catenary start is given between two clamps.
    problem: of these very rod, conditions and member, if known.
    Never raises for a frame that does not converge: its status says so.
    """
    problem = problem or problem_of(rod, conditions, member)
    frames, segments = len(conditions.ends), problem.rods.length.shape[1]
    q, lam, base = starting(problem, conditions, start, turns)
    status, iterations = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    residual = np.empty(frames)
    x, force = np.empty((frames, segments + 1, 3)), np.empty((frames, segments, 3))

    def work(index: slice) -> None:
        kernels.solve_ropes(
            *cut(problem, index), q[index], lam[index], base[index], tolerance, limit,
            status[index], iterations[index], residual[index], x[index], force[index],
        )  # fmt: skip

    in_threads(work, frames)
    found = Solution(q, x, base, lam, force, status, iterations, residual, rod, conditions, member)
    found.__dict__["problem"] = problem
    lost = ~found.converged & (status != kernels.NOT_FINITE)
    if start is None and continuation and lost.any():
        _continue(rod, conditions, problem.rods.of, turns, tolerance, limit, found, lost)
    return found


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
    """Put into `found` the equilibria of the `lost` frames (F,) that continuation in stiffness
    reaches."""
    stiff = rod.stiff if rod.stiff.ndim == 3 else rod.stiff[None]
    owner = of if len(stiff) > 1 else np.zeros_like(of)
    fixed = [t if t.ndim == own else t[of] for t, own in zip(rod, (1, 2, 2, 2, 2, 2), strict=True)]

    def at(factor: np.ndarray, index: np.ndarray, start: States | None) -> Solution:
        """Equilibria of some frames with their stiffness times factor (n,)."""
        few = [t if t.ndim == own else t[index] for t, own in
               zip(fixed, (1, 2, 2, 2, 2, 2), strict=True)]  # fmt: skip
        times = torch.from_numpy(factor)[:, None, None]
        return solve(
            Rod(*few)._replace(stiff=stiff[owner[index]] * times), conditions.frames(index), start,
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


def starting(
    problem: Problem,
    conditions: Conditions,
    start: States | None = None,
    turns: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where a solve begins: frames q (F, N, 4), reactions (F, S) [N], base (F, 3) [m].

    Catenaries, or copies of `start`. Reactions of supports other than the far end's are known from
    a solution with the same supports only, else zero.
    """
    frames, segments = len(conditions.ends), problem.rods.length.shape[1]
    if start is None:
        with np.errstate(invalid="ignore"):  # NaN and infinite loads: the status will say so
            q, reaction, base = _catenaries(problem, conditions, turns)
    else:
        check_shapes(start=(start.q, (frames, segments, 4)))
        q, base = start.q.copy(), start.base.copy()
        reaction = np.zeros((frames, problem.frames.node.size))
        known = conditions.far_supports
        if isinstance(start, Solution) and _same(start.conditions.node, conditions.node):
            known = min(start.reaction.shape[1], reaction.shape[1])
        known = min(known, start.reaction.shape[1])
        reaction[:, :known] = start.reaction[:, :known]
    if not conditions.free:
        base = as_numpy(conditions.ends[:, 0]).copy()
    return q, reaction, base


def _catenaries(
    problem: Problem, conditions: Conditions, turns: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return catenaries, with the tension they have at the far end."""
    rods, held = problem
    frames, segments = len(conditions.ends), rods.length.shape[1]
    arc = np.zeros((len(rods.length), segments + 1))
    np.cumsum(rods.length, axis=1, out=arc[:, 1:])
    weight = rods.load.sum(axis=1)
    ends, clamp = as_numpy(conditions.ends), held.clamp
    q, x, pull = (
        np.empty((frames, segments, 4)),
        np.empty((frames, segments + 1, 3)),
        np.empty(frames),
    )
    turns = np.zeros(frames) if turns is None else np.asarray(turns, dtype=np.float64)
    check_shapes(
        arc=(arc, (len(weight), segments + 1)), weight=(weight, (len(arc), 3)),
        ends=(ends, (frames, 2, 3)), clamp=(clamp, (frames, 2, 4)), turns=(turns, (frames,)),
    )  # fmt: skip

    def work(index: slice) -> None:
        start_ropes(
            arc, rods.of[index], weight, ends[index], clamp[index], turns[index], q[index],
            x[index], pull[index],
        )  # fmt: skip

    in_threads(work, frames)
    if np.isnan(as_numpy(conditions.clamp)).any(-1).all():
        q = _rolled(q, rods.rest[rods.of])
    reaction = np.zeros((frames, held.node.size))
    if conditions.far_held:
        last = x[:, -1] - x[:, -2]
        size = np.linalg.norm(last, axis=1, keepdims=True)
        last = last / np.maximum(size, 1e-300)
        w = weight[rods.of]
        per_length = np.linalg.norm(w, axis=1, keepdims=True) / arc[rods.of, -1:]
        down = w / np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-300)
        along = (last * down).sum(1, keepdims=True)
        across = np.sqrt(np.maximum(1 - along**2, 1e-6))
        # The tension in the last segment, and the load on the node beyond it.
        reaction[:, :3] = per_length * pull[:, None] / across * last - rods.load[rods.of, -1]
        if not conditions.free:
            reaction[:, :3] = np.clip(reaction[:, :3], -1e6, 1e6)
    return q, reaction, x[:, 0].copy()


def _rolled(q: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Frames q (F, N, 4) of ropes that no clamp keeps from rolling about themselves, rolled until
    they bend, on the whole, as they are bent at rest (F, N+1, 4)."""
    wanted = np.nan_to_num(rest[:, 1:-1, 1:3].sum(1, keepdims=True), posinf=0.0, neginf=0.0)
    if not wanted.any():
        return q
    w, x, y, z = np.ascontiguousarray(q.transpose(2, 0, 1))
    (w1, x1, y1, z1), (w2, x2, y2, z2) = (
        [v[:, k : v.shape[1] - 1 + k] for v in (w, x, y, z)] for k in (0, 1)
    )
    bent = [
        (w1 * x2 - x1 * w2 - y1 * z2 + z1 * y2).sum(1),
        (w1 * y2 - y1 * w2 - z1 * x2 + x1 * z2).sum(1),
    ]
    return rolled(q, np.stack(bent, axis=-1)[:, None], wanted)


def stability(solution: Solution) -> np.ndarray:
    """Return the smallest eigenvalue (F,) [N] of the energy's second derivative in the turns of the
    segments (per length), along what the supports allow. Positive: stable.

    The spin of a rope whose ends hold no twist costs nothing: segment 0 is held against it, so that
    a small twist rigidity may set the value.
    """
    problem, out = solution.problem, np.empty(len(solution.q))

    def work(index: slice) -> None:
        kernels.stability_ropes(
            *cut(problem, index), solution.q[index], solution.reaction[index],
            solution.base[index], out[index],
        )  # fmt: skip

    in_threads(work, len(out))
    return out
