"""From parameters to what would be seen, and its derivatives.

Terms act on a setup, then the rod settles. A term is anything that changes a `Setup` by a few
values: a rope parameter, a calibration error, an effect. Values are searched in units of the term's
own scale, so that a step of one is a fair step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect
from ropefit.models.history import WalkedPoint, walk
from ropefit.models.response import Change, Point
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.runs.arrays import as_arrays, from_arrays
from ropefit.runs.journal import Arrays
from ropefit.solvers.equilibrium.branches import wound
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import ARRAYS, Solution, States
from ropefit.solvers.equilibrium.solve import solve

DEEPEST = 0.05  # of the length: a step of a fit goes no deeper into what the rope touches

NEXT_TO_NOTHING = 1e-12  # of a saturating value's search variable, from where it is infinite

Apply = Callable[[Setup, Tensor], Setup]


@dataclass(frozen=True)
class Term:
    """A part of a model: `apply` takes values in SI; a value is scale * (search variable).

    start, lower, upper (n,) in SI; prior (n,) one-sigma in SI, inf for none; log: the search
    variable is the logarithm of the value over its start. saturating (n,) bool: values that may be
    infinite, searched as value / (value + scale). effect: that the term stands for, if any.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    apply: Apply
    start: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    prior: np.ndarray
    log: bool = False
    nuisance: bool = False
    effect: Effect | None = None
    saturating: np.ndarray | None = None

    @property
    def size(self) -> int:
        return len(self.names)

    def value(self, u: np.ndarray) -> np.ndarray:
        """(n,) in SI from search variables (n,)."""
        if self.log:
            return self.start * np.exp(u)
        value = self.start + self.scale * u
        if self.saturating is None:
            return value
        rest = 1 - self._share(self.start) - u
        rest = np.where(rest == 0, NEXT_TO_NOTHING, rest)
        return np.where(self.saturating, self.scale * (1 / rest - 1), value)

    def search(self, value: np.ndarray) -> np.ndarray:
        """(n,) search variables of values in SI."""
        if self.log:
            return np.log(value / self.start)
        u = (value - self.start) / self.scale
        if self.saturating is None:
            return u
        return np.where(self.saturating, self._share(value) - self._share(self.start), u)

    def _share(self, value: np.ndarray) -> np.ndarray:
        """(n,) value / (value + scale), 1 at infinity."""
        return 1 - self.scale / (value + self.scale)

    def slope(self, u: np.ndarray) -> np.ndarray:
        """(n,) derivative of the values in the search variables."""
        if self.log or self.saturating is None:
            return self.value(u) if self.log else self.scale
        stretched = (self.value(u) + self.scale) ** 2 / self.scale
        return np.where(self.saturating, stretched, self.scale)

    def interval(
        self, u: np.ndarray, covariance: np.ndarray, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n,), (n,) values `width` standard deviations to either side, within the bounds;
        covariance (n, n) of the search variables."""
        half = width * np.sqrt(np.maximum(np.diag(covariance), 0))
        least, most = self.search(self.lower), self.search(self.upper)
        low, high = np.clip(u - half, least, most), np.clip(u + half, least, most)
        return self.value(low), self.value(high)


@dataclass
class Forward:
    """A base setup and the terms that act on it, in order. Remembers its last states, and those of
    the frames in between that a rope with memory has been through."""

    base: Setup
    terms: list[Term]
    last: States | None = field(default=None, repr=False)
    path: States | None = field(default=None, repr=False, init=False)
    reached: bool = field(default=False, init=False)  # has all frames settled once

    @property
    def size(self) -> int:
        return sum(term.size for term in self.terms)

    def starting_from(self, states: States) -> Forward:
        """Return the same model, which goes on from other states of its frames."""
        out = Forward(self.base, self.terms, states)
        out.path, out.reached = self.path, self.reached
        return out

    def split(self, u: np.ndarray) -> list[np.ndarray]:
        """Search variables term by term."""
        last = np.cumsum([term.size for term in self.terms], dtype=int)
        return [u[end - t.size : end] for t, end in zip(self.terms, last, strict=True)]

    def start(self) -> np.ndarray:
        return np.zeros(self.size)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(P,), (P,) in search variables."""
        low = np.concatenate([t.search(t.lower) for t in self.terms] or [np.empty(0)])
        high = np.concatenate([t.search(t.upper) for t in self.terms] or [np.empty(0)])
        return low, high

    def prior(self) -> np.ndarray:
        """(P,) one-sigma in search variables; inf for none."""
        return np.concatenate([t.prior / t.scale for t in self.terms] or [np.empty(0)])

    def setup(self, values: list[Tensor]) -> Setup:
        setup = self.base
        for term, value in zip(self.terms, values, strict=True):
            setup = _applied(setup, term, value)
        return setup

    def setup_at(self, u: np.ndarray) -> Setup:
        """The setup at search variables u (P,)."""
        parts = zip(self.terms, self.split(u), strict=True)
        return self.setup([torch.from_numpy(term.value(part)) for term, part in parts])

    def conditions_at(self, u: np.ndarray) -> Conditions:
        """What holds the ends at search variables u (P,)."""
        setup = self.setup_at(u)
        return Conditions(setup.ends, setup.clamp)

    def at(self, u: np.ndarray, start: States | None = None) -> Point:
        """Settle at u. Frames that do not converge are NaN in `seen`."""
        setup = self.setup_at(u)
        start = start or self.last
        if setup.remembers:
            point = walk(u, setup, start, self.path if start is self.last else None)
        else:
            deepest = DEEPEST if self.reached else np.inf
            point = _point(u, setup, _settled(setup, start, deepest))
        self._remember(point)
        return point

    def _remember(self, point: Point) -> None:
        if point.solution.converged.all():
            self.last, self.reached = point.solution, True
            self.path = point.path if isinstance(point, WalkedPoint) else None

    def kept(self, point: Point) -> Arrays:
        """What of the point settled last, and of this model's memory, only settling gives."""
        solution = point.solution
        if isinstance(point, WalkedPoint):
            arrays = as_arrays(point.path, "path.")
        else:
            arrays = {f"solution.{name}": getattr(solution, name) for name in ARRAYS}
            if point.setup.potentials:  # what stands for them comes out of settling
                arrays |= as_arrays(solution.rod, "rod.")
                arrays |= as_arrays(solution.conditions, "conditions.")
        if self.last is not None and self.last is not solution:
            arrays |= {f"last.{f.name}": getattr(self.last, f.name) for f in fields(States)}
        return arrays

    def restored(self, u: np.ndarray, arrays: Arrays) -> Point:
        """The point at u that was kept; the model remembers what it did then."""
        setup = self.setup_at(u)
        if setup.remembers:  # settled once more, from there: what friction held is not kept
            point: Point = walk(u, setup, None, from_arrays(States, "path.", arrays))
        else:
            rod, held = _rod_of(setup), Conditions(setup.ends, setup.clamp)
            if setup.potentials:
                rod = from_arrays(Rod, "rod.", arrays)
                held = from_arrays(Conditions, "conditions.", arrays)
            # The journal's own arrays stay as they were.
            known = {name: arrays[f"solution.{name}"].copy() for name in ARRAYS}
            point = _point(u, setup, Solution(**known, rod=rod, conditions=held))
        self._remember(point)
        if "last.x" in arrays:
            self.last = from_arrays(States, "last.", arrays)
        return point

    def jacobian(self, point: Point) -> np.ndarray:
        """(P, F, K, 3) derivative of `seen` in the search variables."""
        return point.respond(self.changes(point.u))

    def changes(self, u: np.ndarray) -> list[Change]:
        """One for each search variable, at u (P,)."""
        changes, setup, parts = [], self.base, self.split(u)
        for number, (term, part) in enumerate(zip(self.terms, parts, strict=True)):
            for k in range(term.size):
                changes.append(self._change(setup, parts, number, k))
            setup = _applied(setup, term, torch.from_numpy(term.value(part)))
        return changes

    def _change(self, before: Setup, parts: list[np.ndarray], number: int, k: int) -> Change:
        """One term's k-th value changes; before: the setup on which that term acts."""

        def changed(step: float) -> Setup:
            setup = _moved(before, self.terms[number], parts[number], k, step)
            for term, part in zip(self.terms[number + 1 :], parts[number + 1 :], strict=True):
                setup = _applied(setup, term, torch.from_numpy(term.value(part)))
            return setup

        return changed


def _rod_of(setup: Setup) -> Rod:
    """The rod, or one for each frame where loads differ."""
    rod = setup.rod()
    return rod.each(len(rod.load)) if rod.load.ndim == 3 else rod


def _point(u: np.ndarray, setup: Setup, solution: Solution) -> Point:
    seen = setup.seen(torch.from_numpy(solution.x)).numpy().copy()
    seen[~solution.converged] = np.nan
    return Point(u, setup, solution, seen)


def _settled(setup: Setup, start: States | None, deepest: float) -> Solution:
    """Return equilibria of frames, each by itself."""
    conditions, rod = Conditions(setup.ends, setup.clamp), _rod_of(setup)
    if setup.potentials:
        return solve_with_potentials(rod, conditions, setup.potentials, start, deepest)
    solution = solve(rod, conditions, start)
    if start is not None:
        retry = ~solution.converged | wound(solution, start)
        if retry.any():  # from the catenaries
            solution.put(retry, solve(rod, conditions), retry)
    return solution


def _applied(setup: Setup, term: Term, value: Tensor) -> Setup:
    return setup.after(lambda s: term.apply(s, value))


def _moved(setup: Setup, term: Term, u: np.ndarray, k: int, step: float) -> Setup:
    return _applied(setup, term, torch.from_numpy(term.value(u + step * np.eye(term.size)[k])))


def change_by(setup: Setup, term: Term, k: int) -> Change:
    """A further term's k-th value on top of a setup, from the term's start."""
    return lambda step: _moved(setup, term, np.zeros(term.size), k, step)
