"""Settling the frames of a recording: each by itself, or one after the other where the rope
remembers, with the exact derivatives of either.

A frame's equilibrium depends on the frames before by the state that they leave in the branches of
`rod/memory.py`. The derivative of that state is carried from frame to frame along with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ropefit.inference.response import (
    STEP,
    Change,
    Point,
    add_sensor,
    directions_of,
    slopes_of,
)
from ropefit.rod import memory
from ropefit.rod.memory import Laws, State
from ropefit.rod.quaternion import conjugate_product, multiply
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Potential, Setup
from ropefit.solvers.conditions import Conditions, Sliders
from ropefit.solvers.equilibrium import Solution, solve
from ropefit.solvers.implicit import Directions, tangent
from ropefit.solvers.potentials import solve_with_potentials


def settle_frames(
    rod: Rod, conditions: Conditions, potentials: tuple[Potential, ...], start: Solution | None
) -> tuple[Solution, Conditions, Rod]:
    """Equilibria of frames, each by itself, with conditions and rods as they stand there. Frames
    that do not settle are marked."""
    if rod.load.ndim == 3:
        rod = rod.each(len(rod.load))
    if potentials:
        return solve_with_potentials(rod, conditions, potentials, start)
    solution = solve(rod, conditions, start)
    retry = ~solution.converged
    if retry.any() and start is not None:  # from the catenaries
        again = solve(rod, conditions)
        solution.put(retry, again, retry)
    return solution, conditions, rod


@dataclass
class Step:
    """One frame of a walk: what held the rope, its state before, whether a clip begins with it."""

    rod: Rod
    conditions: Conditions
    solution: Solution
    before: State
    first: bool


@dataclass
class WalkedPoint(Point):
    """A `Point` of F frames of a rope that remembers, with all H frames that it has been through:
    `whole` their setup, `path` their states, of which `shown` (F,) are those of the point."""

    whole: Setup
    shown: np.ndarray
    laws: Laws
    steps: list[Step]
    path: Solution

    def respond(self, changes: list[Change]) -> np.ndarray:
        """(P, F, K, 3) first-order changes of the nodes as seen, for P changed setups."""
        if not changes:
            return np.zeros((0, *self.seen.shape))
        frames, count = len(self.steps), len(changes)
        everywhere = [lambda size, c=change: c(size).whole()[0] for change in changes]
        slopes = slopes_of(self.whole, everywhere, self.path)
        _, directions = directions_of(self.whole.rod(), slopes, frames)
        law_slopes = _law_slopes(everywhere)
        rest = np.array(np.broadcast_to(directions.rest, (frames, *directions.rest.shape[1:])))
        nodes = self.whole.segments + 1
        out = np.zeros((frames, count, nodes, 3))
        change = memory.unloaded(np.zeros((count, nodes, 2)), len(self.laws.fresh))
        change = change._replace(strain=np.zeros((count, len(self.laws.fresh), nodes, 2)))
        for t, step in enumerate(self.steps):
            if step.first:
                change = State(rest[t, :, :, :2], np.zeros_like(change.strain))
            if not step.solution.converged[0]:
                out[t] = np.nan
                continue
            vector = vectors(step.rod, step.conditions, step.solution)
            answer = memory.answer(
                self.laws, law_slopes, t, step.first, step.before, change, vector
            )
            # As a change of the rest shape: that is how the solver takes a change of moments.
            stiff = step.rod.stiff.reshape(nodes, 3)[:, :2].numpy()
            shift = answer.force / np.where(stiff > 0, stiff, np.inf)
            own = Directions(*(None if d is None else d[t : t + 1] if len(d) > 1 else d
                               for d in directions))  # fmt: skip
            turned = rest[t].copy()
            turned[..., :2] -= shift
            out[t : t + 1], turns = tangent(
                step.rod, step.conditions, step.solution, own._replace(rest=turned[None])
            )
            change = answer.then(_vector_change(step, turns[0], own.clamp))
        return add_sensor(out, slopes)[:, self.shown]


def walk(u: np.ndarray, setup: Setup, near: Solution | None, path: Solution | None) -> WalkedPoint:
    """Settle a setup with memory, frame after frame, at search variables u (P,).

    near: states of its frames, path: of all that it has been through, to start from. Frames that do
    not settle are NaN in `seen`, and leave no memory.
    """
    whole, shown = setup.whole()
    picked = shown.numpy()
    frames, rod = len(whole.ends), whole.rod()
    law, begins = laws_of(whole), memory.restarts(time_of(whole))
    spins = float(rod.stiff[..., 0, 2]) == 0.0 == float(rod.stiff[..., -1, 2])
    row = {int(t): k for k, t in enumerate(picked)}
    steps: list[Step] = []
    state, last = memory.unloaded(np.zeros((whole.segments + 1, 2)), len(law.fresh)), None
    for t in range(frames):
        first = bool(begins[t])
        one = rod if rod.load.ndim == 2 else rod._replace(load=rod.load[t])
        if first:
            state = memory.unloaded(one.rest[:, :2].numpy(), len(law.fresh))
        sliders = Sliders(*(item[None] for item in memory.sliders(law, t, first, state)))
        held = Conditions(whole.ends[t : t + 1], whole.clamp[t : t + 1], sliders=sliders)
        known = None
        if path is not None:
            known = path.frames(np.array([t]))
        elif near is not None and t in row:
            known = near.frames(np.array([row[t]]))
        toward = state.vector if spins else None
        solution, conditions, rods = _settle_one(one, held, whole.potentials, [known, last], toward)
        steps.append(Step(rods, conditions, solution, state, first))
        if solution.converged[0]:
            last = solution
            state = memory.after(law, t, first, state, vectors(rods, conditions, solution))
    mine = [steps[t] for t in picked]
    solution = stacked([step.solution for step in mine])
    seen = setup.seen(torch.from_numpy(solution.x)).numpy().copy()
    seen[~solution.converged] = np.nan
    rods = Rod(*(torch.cat(f) for f in zip(*(s.rod.each(1) for s in mine), strict=True)))
    held = merged([step.conditions for step in mine])
    path = stacked([step.solution for step in steps])
    return WalkedPoint(u, setup, rods, held, solution, seen, whole, picked, law, steps, path)


def _settle_one(
    rod: Rod,
    held: Conditions,
    potentials: tuple[Potential, ...],
    starts: list[Solution | None],
    toward: np.ndarray | None,
) -> tuple[Solution, Conditions, Rod]:
    """A frame's equilibrium from the first start that leads to one, in the end from that of a rope
    without a past.

    toward (N+1, 2): where a rope that is free to spin has its bends, as near as it can.
    """
    for start in [*(s for s in starts if s is not None), None]:
        if start is None:
            start = settle_frames(rod, replace(held, sliders=None), potentials, None)[0]
        if toward is not None and start.converged[0]:
            start = _spun(rod, held, start, toward)
        found = settle_frames(rod, held, potentials, start)
        if found[0].converged[0]:
            break
    return found


def _spun(rod: Rod, held: Conditions, start: Solution, toward: np.ndarray) -> Solution:
    """A start whose frames are all spun alike, for its bends to lie as those of `toward`."""
    v = vectors(rod, held, start)
    along, across = (v * toward).sum(), (v[:, 1] * toward[:, 0] - v[:, 0] * toward[:, 1]).sum()
    angle = float(np.arctan2(across, along))
    spin = torch.tensor([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)], dtype=torch.float64)
    out = start.copy()
    out.q[:] = multiply(torch.from_numpy(start.q), spin).numpy()
    return out


def vectors(rod: Rod, held: Conditions, solution: Solution) -> np.ndarray:
    """(N+1, 2) the vector parts of one frame's bend elements; zero where there is none."""
    return _darboux(rod, held, solution)[:, 1:3]


def _darboux(rod: Rod, held: Conditions, solution: Solution) -> np.ndarray:
    """(N+1, 4) the Darboux quaternions of one frame; zero where nothing is bent."""
    q, clamp = torch.from_numpy(solution.q[0]), torch.nan_to_num(held.clamp[0])
    around = torch.cat([clamp[:1], q, clamp[1:]])
    p = conjugate_product(around[:-1], around[1:]).numpy()
    rest = rod.rest.reshape(len(p), 3).numpy()
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1), 0.0))
    nearer = p[:, 0] * real + (p[:, 1:] * rest).sum(-1)
    stiff = rod.stiff.reshape(len(p), 3).numpy()
    return p * np.where(nearer < 0, -1.0, 1.0)[:, None] * (stiff > 0).any(-1)[:, None]


def _vector_change(step: Step, turns: np.ndarray, clamp: np.ndarray | None) -> np.ndarray:
    """(P, N+1, 2) change of the vectors when the frames turn by (P, N, 3), the clamps by clamp
    (1, P, 2, 3), each about its own axes."""
    p = _darboux(step.rod, step.conditions, step.solution)
    ends = np.zeros((1, len(turns), 2, 3)) if clamp is None else clamp
    every = np.concatenate([ends[0, :, :1], turns, ends[0, :, 1:]], axis=1)
    low, high = every[:, :-1], every[:, 1:]
    moved = 0.5 * (p[:, :1] * (high - low) + np.cross(p[:, 1:], high + low))
    return moved[..., :2]


def _law_slopes(changes: list[Change]) -> Laws:
    """Derivatives of the branches' laws in P changes."""
    rows = []
    for changed in changes:
        low, high = (laws_of(changed(size)) for size in (-STEP, STEP))
        with np.errstate(invalid="ignore"):
            rows.append([np.nan_to_num((b - a) / (2 * STEP), posinf=0.0, neginf=0.0)
                         for a, b in zip(low[:4], high[:4], strict=True)])  # fmt: skip
    fields = (np.stack(field) for field in zip(*rows, strict=True))
    return Laws(*fields, fresh=np.empty(0))


def laws_of(setup: Setup) -> Laws:
    """What a setup's rope remembers by."""
    return memory.laws(setup.memory, setup.rod(), setup.properties.bend, time_of(setup))


def time_of(setup: Setup) -> Tensor:
    """(F,) [s], a second a frame where no time is known."""
    if setup.time is not None:
        return setup.time
    return torch.arange(len(setup.ends), dtype=torch.float64)


def stacked(parts: list[Solution]) -> Solution:
    """Solutions of one frame each as one. Reactions of supports that only some have are lost."""
    few = min(s.reaction.shape[1] for s in parts)
    return Solution(
        *(
            np.concatenate([getattr(s, n)[:, :few] if n == "reaction" else getattr(s, n)
                            for s in parts])
            for n in Solution.__dataclass_fields__
        )
    )  # fmt: skip


def merged(parts: list[Conditions]) -> Conditions:
    """Conditions of one frame each as one."""
    sliders = Sliders(*(np.concatenate(f) for f in zip(*(p.sliders for p in parts), strict=True)))
    ends, clamp = (torch.cat([getattr(p, n) for p in parts]) for n in ("ends", "clamp"))
    return Conditions(ends, clamp, sliders=sliders)
