"""The frames of a rope that remembers, as they settled one after the other, with the exact
derivatives.

A frame's equilibrium depends on the frames before by the state that they leave in the branches of
`rod/memory.py`. The derivative of that state is carried from frame to frame along with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ropefit.models.bends import (
    darboux,
    vector_change,
    vectors,
)
from ropefit.models.increments import in_increments
from ropefit.models.response import (
    Parts,
    Point,
    add_sensor,
    directions_of,
    law_moments,
    seen_move,
    turned_to_bends,
    with_axial_law,
)
from ropefit.models.rubbing import rubbings
from ropefit.models.slopes import Change, same_rod, slopes_of
from ropefit.rod import memory
from ropefit.rod.differences import DIFFERENCE_STEP
from ropefit.rod.friction import Grip
from ropefit.rod.memory import Laws, State
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.solution import Solution, States


@dataclass
class Step:
    """One frame of a walk: how it settled, the state of its memory before, where each contact with
    friction held it, whether a clip begins with it."""

    solution: Solution
    before: State
    grips: list[Grip]
    first: bool


@dataclass
class WalkedPoint(Point):
    """A `Point` of F frames of a rope that remembers, with all H frames that it has been through:
    `whole` their setup, `path` their states (q is NaN where a frame did not settle), of which
    `shown` (F,) are those of the point. increments: in how many of them each frame of the recording
    was reached, see `models.increments`."""

    whole: Setup
    shown: np.ndarray
    laws: Laws
    steps: list[Step]
    path: States
    increments: np.ndarray

    def parts(
        self, changes: list[Change], turned: bool = False, nodes: np.ndarray | None = None
    ) -> Parts:
        moved = self.respond(changes, turned)
        yield np.arange(len(self.seen)), moved if nodes is None else moved[:, :, nodes]

    def respond(self, changes: list[Change], turned: bool = False) -> np.ndarray:
        """Return (P, F, K, 3) first-order changes of the nodes as seen, for P changed setups."""
        if not changes:
            return np.zeros((0, *self.seen.shape))
        frames, count, nodes = len(self.steps), len(changes), self.whole.segments + 1
        everywhere: list[Change] = [
            cache(lambda size, c=change: in_increments(c(size).whole()[0], self.increments))
            for change in changes
        ]
        slopes = slopes_of(self.whole, everywhere, self.path)
        rods = self.whole.rod()
        directions = directions_of(rods, slopes, frames)
        if turned:
            bends = np.concatenate([vectors(step.solution) for step in self.steps])
            directions = turned_to_bends(directions, rods, bends)
        directions = with_axial_law(directions, rods, [s.solution for s in self.steps], slopes)
        law_slopes = _law_slopes(everywhere)
        rubbing = rubbings(self.whole, everywhere, [s.grips for s in self.steps], self.path.x)
        rest, load = (in_frames(d, frames) for d in (directions.rest, directions.load))
        out = np.zeros((frames, count, nodes, 3))
        seen = np.zeros_like(out)
        branches = len(self.laws.fresh)
        change = State(np.empty(0), np.zeros((count, branches, nodes, 2)))
        moved = np.zeros((len(rubbing), count, nodes, 3))  # of where friction holds the nodes
        for t, step in enumerate(self.steps):
            if step.first:
                change = State(rest[t, :, :, :2], np.zeros_like(change.strain))
                moved[:] = 0.0
            if not step.solution.converged[0]:
                seen[t] = np.nan
                continue
            p = darboux(step.solution)[0]
            answer = memory.answer(
                self.laws, law_slopes, t, step.first, step.before, change, p[:, 1:3]
            )
            # As a change of the rest shape: that is how the solver takes a change of moments.
            stiff = step.solution.rod.stiffness.reshape(nodes, 3)[:, :2]
            force = answer.force + law_moments(slopes, p[None, :, 1:3])[0]
            rest[t, :, :, :2] -= force / np.where(stiff > 0, stiff, np.inf)
            own = Directions(*(None if d is None else d[t : t + 1] if len(d) > 1 else d
                               for d in directions))  # fmt: skip
            own = own._replace(rest=rest[t : t + 1])
            drawn = load[t] + sum(r.drawn(t, a) for r, a in zip(rubbing, moved, strict=True))
            out[t], turns = _with_friction(step, own, drawn, [r.missed[t] for r in rubbing])
            seen[t] = seen_move(self.whole, step.solution.q, out[t : t + 1], turns[None])[0]
            change = answer.then(
                vector_change(p, turns, None if own.clamp is None else own.clamp[0])
            )
            for r, a in zip(rubbing, moved, strict=True):
                a[:] = r.then(t, a, out[t])
        return add_sensor(seen, slopes, self.setup.sensor)[:, self.shown]


def _with_friction(
    step: Step, own: Directions, load: np.ndarray, missed: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return changes (P, N+1, 3) of one frame's nodes and (P, N, 3) turns of its frames.

    missed (N+1, 3, 3) [N/m]: friction's stiffness that its supports do not have, since it grows
    with the normal force. The force from it is that for which the nodes that it acts on move as
    they must to cause it.
    """
    dx, turns = (a[0] for a in tangent(step.solution, own._replace(load=load[None])))
    stiff = sum(missed, np.zeros((load.shape[1], 3, 3)))
    at = np.flatnonzero(stiff.any((1, 2)))
    if not len(at):
        return dx, turns
    unit = np.zeros((len(at), 3, load.shape[1], 3))
    unit[np.arange(len(at)), :, at] = np.eye(3)
    unit = unit.reshape(1, -1, *load.shape[1:])
    by, turning = (a[0] for a in tangent(step.solution, Directions(load=unit)))
    loop = np.einsum("iab,fib->iaf", stiff[at], by[:, at]).reshape(len(by), len(by))
    begun = np.einsum("iab,pib->iap", stiff[at], dx[:, at]).reshape(len(by), -1)
    force = np.linalg.solve(np.eye(len(by)) - loop, begun).T
    return dx + np.tensordot(force, by, 1), turns + np.tensordot(force, turning, 1)


def in_frames(values: np.ndarray | None, frames: int) -> np.ndarray:
    """Return (H, ...) a copy of values (H, ...) or (1, ...)."""
    assert values is not None
    return np.array(np.broadcast_to(values, (frames, *values.shape[1:])))


def _law_slopes(changes: list[Change]) -> Laws:
    """Return derivatives of the branches' laws in P changes."""
    rows, none = [], [np.zeros_like(value) for value in laws_of(changes[0](DIFFERENCE_STEP))[:4]]
    for changed in changes:
        a, b = changed(-DIFFERENCE_STEP), changed(DIFFERENCE_STEP)
        if a.memory is b.memory and same_rod(a, b):
            rows.append(none)
            continue
        low, high = laws_of(a), laws_of(b)
        with np.errstate(invalid="ignore"):
            rows.append([np.nan_to_num((q - p) / (2 * DIFFERENCE_STEP), posinf=0.0, neginf=0.0)
                         for p, q in zip(low[:4], high[:4], strict=True)])  # fmt: skip
    fields = (np.stack(field) for field in zip(*rows, strict=True))
    return Laws(*fields, fresh=np.empty(0), gradual=np.empty(0))


def laws_of(setup: Setup) -> Laws:
    """Return what a setup's rope remembers by."""
    return memory.laws(setup.memory, setup.rod(), setup.properties.bend, setup.clock)
