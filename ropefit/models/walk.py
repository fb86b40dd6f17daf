"""Settling the frames of a recording one after the other, where the rope remembers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.models.bends import axial_law_of, elements_of, joined, merged, spun, stacked, vectors
from ropefit.models.history import Step, WalkedPoint, laws_of
from ropefit.models.increments import in_increments, increments_of
from ropefit.models.rubbing import loose
from ropefit.rod import friction, memory
from ropefit.rod.memory import Laws, State
from ropefit.rod.potential import Potential
from ropefit.rod.quaternion import conjugate_product, multiply
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import Solution, States, unsettled
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.turns import rolled


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
            starts: list[States | None] = [known, last]
            if rough and not first and last is not None:
                # Friction has many equilibria: the one that the rope is dragged to on its way.
                before = None if path is None else path.frames(np.array([t - 1]))
                starts = [_moved_alike(last, before, known), last, known]
            solution = _settle_one(one, held, (*whole.potentials, *rubbing), starts, toward)
        steps.append(Step(solution, state, grips, first))
        lost = not solution.converged[0]
        if not lost:
            last, x = solution, solution.x[0]
            state = memory.after(law, t, first, state, vectors(solution)[0])
            grips = [friction.after(p, g, x) for p, g in zip(rough, grips, strict=True)]
    solution = merged([steps[t].solution for t in picked])
    seen = setup.seen(solution.x, solution.q)
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
    seen = setup.seen(solution.x, solution.q)
    parts = np.ones(len(begins), dtype=int)
    return WalkedPoint(u, setup, solution, seen, whole, shown, law, steps, every.states, parts)


def _moved_alike(last: States, before: States | None, after: States | None) -> States | None:
    """Return where one frame's rope is if it moves from its `last` state as it did from the one
    `before` to the one `after`; None if that is not known."""
    if before is None or after is None:
        return None
    far = after.reaction.shape[1]
    return States(
        multiply(after.q, conjugate_product(before.q, last.q)),
        last.x + (after.x - before.x),
        last.base + (after.base - before.base),
        last.reaction[:, :far] + (after.reaction - before.reaction),
    )


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
