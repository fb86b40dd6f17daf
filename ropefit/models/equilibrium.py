"""The rope at rest: every frame in equilibrium, with the exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np

from ropefit.models.bends import conditions_of
from ropefit.models.history import WalkedPoint
from ropefit.models.model import Model
from ropefit.models.response import Point
from ropefit.models.terms import Term
from ropefit.models.walk import walk
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.runs.arrays import as_arrays, from_arrays
from ropefit.runs.journal import Arrays
from ropefit.solvers.equilibrium.branches import wound
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.implicit import following
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import ARRAYS, Solution, States, at_nodes_of
from ropefit.solvers.equilibrium.solve import NEWTON_LIMIT, solve

# Newton steps of a frame in a step of a fit: nearly all take less than ten, and one that takes more
# than these jumps, or is lost.
STEP_LIMIT = 60
DEEPEST = 0.05  # of the length: a step of a fit, in which all frames settle, goes no deeper into
# what the rope touches


@dataclass
class Equilibrium(Model):
    """Frames at rest. Remembers its last states, and those of the frames in between that a rope
    with memory has been through, always in the same increments: with others, at another step of a
    fit, what is fitted would have jumps."""

    coarser: Setup | None = field(default=None, repr=False)  # the same rope of fewer segments
    path: States | None = field(default=None, repr=False, init=False)
    increments: np.ndarray | None = field(default=None, repr=False, init=False)
    reached: bool = field(default=False, init=False)  # has all frames settled once
    at_once: bool = field(default=False, init=False)  # frames that do not settle are not begun anew

    def starting_from(self, states: States) -> Equilibrium:
        """Return the same model, which goes on from other states of its frames."""
        out = Equilibrium(self.base, self.terms, states, coarser=self.coarser)
        out.path, out.increments, out.reached = self.path, self.increments, self.reached
        return out

    def of_setup(
        self, setup: Setup, states: States | None = None, terms: list[Term] | None = None
    ) -> Equilibrium:
        return Equilibrium(setup, terms or [], states)  # the coarser mesh is not of that setup

    def settling_at_once(self) -> Equilibrium:
        out = self.with_terms(self.terms, self.last)
        out.at_once = True
        return out

    def coarsened(self, point: Point) -> Equilibrium | None:
        if self.coarser is None or point.setup.remembers:
            return None  # what is remembered would have to be gone through again
        base, solution = self.coarser, point.solution
        states = solution.of_segments(base.segments)
        rough = Equilibrium(base, self.terms, states).at(point.u)
        if not rough.converged.all():
            return None
        drift = at_nodes_of(base.segments, solution.x) - rough.solution.x
        corrected = base._replace(sensor=base.sensor._replace(drift=drift))
        return Equilibrium(corrected, self.terms, rough.solution)

    def conditions_at(self, u: np.ndarray) -> Conditions:
        """Return what holds the ends at search variables u (P,)."""
        return conditions_of(self.setup_at(u))

    def at(self, u: np.ndarray, start: States | None = None) -> Point:
        """Settle at u. Frames that do not converge are NaN in `seen`."""
        setup = self.setup_at(u)
        start = start or self.last
        if setup.remembers:
            path = self.path if start is self.last else None
            point = walk(u, setup, start, path, self.increments)
        else:
            deepest = DEEPEST if self.reached else np.inf
            point = _point(u, setup, _settled(setup, start, deepest, self.at_once))
        self.remember(point)
        return point

    def remember(self, point: Point) -> None:
        """Go on from a point, if all of its frames have settled."""
        if point.solution.converged.all():
            self.last, self.reached = point.solution, True
            walked = point if isinstance(point, WalkedPoint) else None
            self.path = walked and walked.path
            self.increments = walked and walked.increments

    def kept(self, point: Point) -> Arrays:
        """Return what of the point settled last, and of this model's memory, only settling
        gives."""
        solution = point.solution
        if isinstance(point, WalkedPoint):
            arrays = as_arrays(point.path, "path.") | {"increments": point.increments}
        else:
            arrays = {f"solution.{name}": getattr(solution, name) for name in ARRAYS}
            if _settled_loads(point.setup):  # what stands for them comes out of settling
                arrays["load"] = solution.rod.load
                # The laws are the setup's.
                held = replace(solution.conditions, friction_elements=None, axial=None)
                arrays |= as_arrays(held, "conditions.")
        if self.last is not None and self.last is not solution:
            arrays |= {f"last.{f.name}": getattr(self.last, f.name) for f in fields(States)}
        return arrays

    def restored(self, u: np.ndarray, arrays: Arrays) -> Point:
        """Return the point at u that was kept; the model remembers what it did then."""
        setup = self.setup_at(u)
        if setup.remembers:  # settled once more, from there: what friction held is not kept
            path = from_arrays(States, "path.", arrays)
            point: Point = walk(u, setup, None, path, arrays["increments"])
        else:
            rod = _rod_of(setup)
            laws = held = conditions_of(setup, rod)
            if _settled_loads(setup):
                load = arrays["load"].copy()
                rod = (rod.each(len(load)) if load.ndim == 3 else rod)._replace(load=load)
                held = from_arrays(Conditions, "conditions.", arrays)
                held = replace(held, friction_elements=laws.friction_elements, axial=laws.axial)
            # The journal's own arrays stay as they were.
            known = {name: arrays[f"solution.{name}"].copy() for name in ARRAYS}
            point = _point(
                u, setup, Solution(**known, rod=rod, conditions=held, followers=setup.followers)
            )
        self.remember(point)
        if "last.x" in arrays:
            self.last = from_arrays(States, "last.", arrays)
        return point


def _settled_loads(setup: Setup) -> bool:
    """Return whether the rod's loads depend on its state."""
    return bool(setup.potentials or setup.followers)


def _rod_of(setup: Setup) -> Rod:
    """Return the rod, or one for each frame where loads differ."""
    rod = setup.rod()
    return rod.each(len(rod.load)) if rod.load.ndim == 3 else rod


def _point(u: np.ndarray, setup: Setup, solution: Solution) -> Point:
    seen = setup.seen(solution.x, solution.q)
    seen[~solution.converged] = np.nan
    return Point(u, setup, solution, seen)


def _settled(setup: Setup, start: States | None, deepest: float, at_once: bool) -> Solution:
    """Return equilibria of frames, each by itself; of steps of a fit (`deepest`) or at once none,
    where a force that follows the rope does not come to rest in one."""
    rod = _rod_of(setup)
    if not setup.followers:
        return _under_dead_loads(setup, rod, start, deepest, at_once)

    def settle(load: np.ndarray, near: States | None) -> Solution:
        own = rod.each(len(setup.ends))
        with_load = own._replace(load=own.load + load) if load.size else own
        return _under_dead_loads(setup, with_load, near, deepest, at_once)

    return following(settle, setup.followers, start, every=at_once or deepest < np.inf)


def _under_dead_loads(
    setup: Setup, rod: Rod, start: States | None, deepest: float, at_once: bool
) -> Solution:
    conditions = conditions_of(setup, rod)
    if setup.potentials:
        return solve_with_potentials(rod, conditions, setup.potentials, start, deepest, at_once)
    step = deepest < np.inf or at_once
    limit = STEP_LIMIT if step and start is not None else NEWTON_LIMIT
    solution = solve(rod, conditions, start, limit=limit)
    if start is not None:
        retry = ~solution.converged | wound(solution, start)
        # From the catenaries; of a step of a fit no further, and not where every frame is lost: it
        # is taken back.
        if retry.any() and not (step and not solution.converged.any()):
            solution.put(retry, solve(rod, conditions, continuation=not step), retry)
    return solution
