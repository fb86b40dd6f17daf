"""States of a rope in equilibrium, and solutions: states with what they were solved under."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np

from ropefit.rod.quaternion import normalise
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Follower
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.problem import Problem, problem_of
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.status import Status

Index = int | np.integer | slice | np.ndarray


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

    def of_segments(self, segments: int) -> States:
        """Return about the same shapes on a mesh of so many equal segments; these states where
        they are of as many."""
        from scipy.interpolate import interp1d  # slow to load, and few ask for it

        if self.q.shape[1] == segments:
            return self
        old, new = self.q.shape[1], (np.arange(segments) + 0.5) / segments
        turned = (self.q[:, 1:] * self.q[:, :-1]).sum(-1) < 0  # q and -q are the same turn
        sign = np.cumprod(np.where(turned, -1.0, 1.0), axis=1)
        q = np.concatenate([self.q[:, :1], sign[..., None] * self.q[:, 1:]], axis=1)
        middles = (np.arange(old) + 0.5) / old
        inside = np.clip(new, middles[0], middles[-1])
        q = normalise(interp1d(middles, q, axis=1)(inside))
        return States(q, at_nodes_of(segments, self.x), self.base.copy(), self.reaction.copy())

    def put(self, mine: Index, other: States, theirs: Index = slice(None)) -> None:
        """Replace frames `mine` by the frames `theirs` of other states."""
        for name in ("q", "x", "base"):
            getattr(self, name)[mine] = getattr(other, name)[theirs]
        known = self.reaction.shape[1]
        self.reaction[mine] = other.reaction[theirs][..., :known]


def at_nodes_of(segments: int, x: np.ndarray) -> np.ndarray:
    """Return (F, segments+1, 3) [m] the places that nodes x (F, N+1, 3) [m] have on a mesh of so
    many equal segments: on cubics through them."""
    from scipy.interpolate import interp1d

    old, new = (np.linspace(0, 1, many) for many in (x.shape[1], segments + 1))
    return interp1d(old, x, kind="cubic", axis=1)(new)


_STATES = tuple(field.name for field in fields(States))


@dataclass(frozen=True)
class Solution(States):
    """States of F frames, the rod and the conditions that they were solved under, and how it went.

    reaction (F, S) [N] of all supports, the far end's first; force (F, N, 3) [N] in the segments;
    status (F,) of `Status`, iterations (F,), residual (F,); member (F,): which of the rod's R ropes
    each frame shows; followers: of the rod's load, forces that turn with it.
    Derivatives and stability are computed from a solution alone, so that no state meets conditions
    which are not its own. Raises ShapeError where the arrays do not belong together.
    """

    force: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    residual: np.ndarray
    rod: Rod = field(repr=False)
    conditions: Conditions = field(repr=False)
    member: np.ndarray | None = field(repr=False, default=None)
    followers: tuple[Follower, ...] = field(repr=False, default=())

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
        """Return (F,) bool: the frames in a stable equilibrium."""
        return self.status == Status.CONVERGED

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
        held = self.conditions.frames(index)
        return Solution(**arrays, rod=rod, conditions=held, member=member, followers=self.followers)

    def put(self, mine: Index, other: Solution, theirs: Index = slice(None)) -> None:
        """Replace frames `mine` by the frames `theirs` of another solution of the same frames.

        Raises ValueError where the two were not held by the same supports.
        """
        if not same_supports(self.conditions, other.conditions):
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
        self.force[mine], self.status[mine] = 0.0, Status.LIMIT

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
        np.zeros((frames, segments, 3)), np.full(frames, Status.LIMIT),
        np.zeros(frames, dtype=np.int64), np.full(frames, np.inf), rod, conditions,
    )  # fmt: skip


def same_supports(one: Conditions, other: Conditions) -> bool:
    """Return whether the same nodes are supported."""
    none = np.empty(0, dtype=np.int64)
    a, b = (none if c.node is None else c.node for c in (one, other))
    return np.array_equal(a, b)
