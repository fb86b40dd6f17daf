"""Settling the frames of a recording one after the other, where the rope remembers, with the exact
derivatives.

A frame's equilibrium depends on the frames before by the state that they leave in the branches of
`rod/memory.py`. The derivative of that state is carried from frame to frame along with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ropefit.models.bends import (
    axial_law_of,
    darboux,
    elements_of,
    joined,
    merged,
    spun,
    stacked,
    vector_change,
    vectors,
)
from ropefit.models.increments import in_increments, increments_of
from ropefit.models.response import (
    DIFFERENCE_STEP,
    Change,
    Parts,
    Point,
    add_sensor,
    directions_of,
    law_moments,
    same_rod,
    slopes_of,
    turned_to_bends,
    with_axial_law,
)
from ropefit.models.rubbing import loose, rubbings
from ropefit.rod import friction, memory
from ropefit.rod.friction import Grip
from ropefit.rod.memory import Laws, State
from ropefit.rod.potential import Potential
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import Solution, States, unsettled
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.turns import rolled


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

    def parts(self, changes: list[Change], turned: bool = False) -> Parts:
        yield np.arange(len(self.seen)), self.respond(changes, turned)

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
        branches = len(self.laws.fresh)
        change = State(np.empty(0), np.zeros((count, branches, nodes, 2)))
        moved = np.zeros((len(rubbing), count, nodes, 3))  # of where friction holds the nodes
        for t, step in enumerate(self.steps):
            if step.first:
                change = State(rest[t, :, :, :2], np.zeros_like(change.strain))
                moved[:] = 0.0
            if not step.solution.converged[0]:
                out[t] = np.nan
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
            change = answer.then(
                vector_change(p, turns, None if own.clamp is None else own.clamp[0])
            )
            for r, a in zip(rubbing, moved, strict=True):
                a[:] = r.then(t, a, out[t])
        return add_sensor(out, slopes, self.setup.sensor)[:, self.shown]


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


def walk(
    u: np.ndarray, setup: Setup, near: States | None, path: States | None,
    parts: np.ndarray | None = None,
) -> WalkedPoint:  # fmt: skip
    """Settle a setup with memory, frame after frame, at search variables u (P,).

    near: states of its frames, path: of all that it has been through, to start from. parts (H,):
    in how many increments each frame is reached; None: as many as it takes. A frame that
    does not settle leaves those after it, to the end of its clip, without a known past: they are
    not settled either, and NaN in `seen`.
    """
    whole, picked = setup.whole()
    rod, law = whole.rod(), laws_of(whole)
    elastic = elements_of(whole, rod, 1)
    spins = float(rod.stiffness[..., 0, 2]) == 0.0 == float(rod.stiffness[..., -1, 2])
    rough = [p for p in whole.potentials if p.friction is not None]
    if not rough and not law.drag.any():  # branches of no size, whose derivative is wanted
        every = _without_past(whole, rod, elastic, near, picked)
        if every.converged.all():
            return _walked(u, setup, law, memory.restarts(whole.clock), every, spins)
    if parts is None:

        def without_past(parts: np.ndarray) -> Solution:
            fine = in_increments(whole, parts)
            return _without_past(fine, fine.rod(), elastic, near, (np.cumsum(parts) - 1)[picked])

        parts = increments_of(whole, rough, law, spins, without_past)
    whole, picked = in_increments(whole, parts), (np.cumsum(parts) - 1)[picked]
    frames, rod, law = len(whole.ends), whole.rod(), laws_of(whole)
    path = path if path is not None and len(path.x) == frames else None
    begins, row = memory.restarts(whole.clock), {int(t): k for k, t in enumerate(picked)}
    steps: list[Step] = []
    state, grips, last = State(np.empty(0), np.empty(0)), [], None
    for t in range(frames):
        first = bool(begins[t])
        one = rod if rod.load.ndim == 2 else rod._replace(load=rod.load[t])
        if first:
            lost = False
            state = memory.unloaded(one.rest[:, :2], len(law.fresh))
            grips = [loose(whole.segments + 1) for _ in rough]
        past = FrictionElements(
            *(item[None] for item in memory.friction_elements(law, t, first, state))
        )
        held = Conditions(
            whole.ends[t : t + 1], whole.clamp[t : t + 1],
            friction_elements=joined(past, elastic), axial=axial_law_of(whole),
        )  # fmt: skip
        known = None
        if path is not None:
            known = path.frames(np.array([t]))
        elif near is not None and t in row:
            known = near.frames(np.array([row[t]]))
        toward = state.vector if spins else None
        rubbing = (friction.potential(p, g) for p, g in zip(rough, grips, strict=True))
        if lost:
            solution = unsettled(one, held, steps[-1].solution.states)
        else:
            # Friction has many equilibria: the one that the rope is dragged to on its way.
            starts = [last, known] if rough and not first else [known, last]
            solution = _settle_one(one, held, (*whole.potentials, *rubbing), starts, toward)
        steps.append(Step(solution, state, grips, first))
        lost = not solution.converged[0]
        if not lost:
            last, x = solution, solution.x[0]
            state = memory.after(law, t, first, state, vectors(solution)[0])
            grips = [friction.after(p, g, x) for p, g in zip(rough, grips, strict=True)]
    solution = merged([steps[t].solution for t in picked])
    seen = setup.sensor(solution.x).copy()
    seen[~solution.converged] = np.nan
    path = stacked([step.solution for step in steps])
    return WalkedPoint(u, setup, solution, seen, whole, picked, law, steps, path, parts)


def _without_past(
    whole: Setup, rod: Rod, elastic: FrictionElements | None, near: States | None,
    picked: np.ndarray,
) -> Solution:  # fmt: skip
    """Return all frames' equilibria at once, each from the nearest of the `picked` frames, whose
    states are `near`."""
    frames = len(whole.ends)
    if elastic is not None:
        elastic = FrictionElements(*(np.repeat(item, frames, axis=0) for item in elastic))
    held = Conditions(whole.ends, whole.clamp, friction_elements=elastic, axial=axial_law_of(whole))
    nearest = np.abs(np.arange(frames)[:, None] - picked).argmin(axis=1)
    start = None if near is None else near.states if isinstance(near, Solution) else near
    start = None if start is None else start.frames(nearest)
    if whole.potentials:
        return solve_with_potentials(rod, held, whole.potentials, start)
    return solve(rod, held, start)


def _walked(
    u: np.ndarray, setup: Setup, law: Laws, begins: np.ndarray, every: Solution, spins: bool
) -> WalkedPoint:
    """Return the point of frames that settled without regard to their past, with what branches of
    no size remember of it."""
    whole, shown = setup.whole()
    steps: list[Step] = []
    state = State(np.empty(0), np.empty(0))
    for t, first in enumerate(begins):
        one = every.frames(np.array([t]))
        if first:
            state = memory.unloaded(one.rod.rest.reshape(-1, 3)[:, :2], len(law.fresh))
        if spins:
            one = replace(one, q=rolled(one.q, vectors(one), state.vector[None]))
        steps.append(Step(one, state, [], bool(first)))
        state = memory.after(law, t, bool(first), state, vectors(one)[0])
    every = every.copy()
    every.q[:] = np.concatenate([step.solution.q for step in steps])
    solution = every.frames(shown)
    seen = setup.sensor(solution.x).copy()
    parts = np.ones(len(begins), dtype=int)
    return WalkedPoint(u, setup, solution, seen, whole, shown, law, steps, every.states, parts)


def _settle_one(
    rod: Rod,
    held: Conditions,
    potentials: tuple[Potential, ...],
    starts: list[States | None],
    toward: np.ndarray | None,
) -> Solution:
    """Return a frame's equilibrium from the first start that leads to one, in the end from that of
    a rope without a past.

    toward (N+1, 2): where a rope that is free to spin has its bends, as near as it can.
    """
    for start in [*(s for s in starts if s is not None and _arrived(s)), None]:
        if start is None:
            start = solve(rod, replace(held, friction_elements=None), continuation=False)
        if toward is not None and _arrived(start):
            start = spun(rod, held, start, toward)
        if potentials:
            found = solve_with_potentials(rod, held, potentials, start)
        else:
            found = solve(rod, held, start)
        if found.converged[0]:
            break
    return found


def _arrived(states: States) -> bool:
    """Return whether the one frame of some states had settled."""
    settled = states.converged[0] if isinstance(states, Solution) else np.isfinite(states.q).all()
    return bool(settled)


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
