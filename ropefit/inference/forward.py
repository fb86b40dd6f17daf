"""From parameters to what would be seen, and its derivatives.

Terms act on a setup, then the rod settles. A term is anything that changes a `Setup` by a few
values: a rope parameter, a calibration error, an effect. Values are searched in units of the term's
own scale, so that a step of one is a fair step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
import torch.autograd.forward_ad as forward_ad
from torch import Tensor

from ropefit.rod.quaternion import conjugate_product
from ropefit.rod.rod import Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.conditions import Conditions
from ropefit.solvers.equilibrium import Solution, solve
from ropefit.solvers.implicit import Directions, tangent
from ropefit.solvers.potentials import solve_with_potentials, springs

Apply = Callable[[Setup, Tensor], Setup]
Change = Callable[[], Setup]  # a setup some of whose tensors are dual numbers


@dataclass(frozen=True)
class Term:
    """A part of a model: `apply` takes values in SI; a value is scale * (search variable).

    start, lower, upper (n,) in SI; prior (n,) one-sigma in SI, inf for none; log: the search
    variable is the logarithm of the value over its start.
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

    @property
    def size(self) -> int:
        return len(self.names)

    def value(self, u: np.ndarray) -> np.ndarray:
        """(n,) in SI from search variables (n,)."""
        return self.start * np.exp(u) if self.log else self.start + self.scale * u

    def search(self, value: np.ndarray) -> np.ndarray:
        """(n,) search variables of values in SI."""
        return np.log(value / self.start) if self.log else (value - self.start) / self.scale

    def slope(self, u: np.ndarray) -> np.ndarray:
        """(n,) derivative of the values in the search variables."""
        return self.value(u) if self.log else self.scale


@dataclass
class Point:
    """A model evaluated at search variables u (P,): setup, states, and nodes as seen (F, K, 3)."""

    u: np.ndarray
    setup: Setup
    rod: Rod
    conditions: Conditions
    solution: Solution
    seen: np.ndarray


@dataclass
class Forward:
    """A base setup and the terms that act on it, in order. Remembers its last states."""

    base: Setup
    terms: list[Term]
    last: Solution | None = field(default=None, repr=False)

    @property
    def size(self) -> int:
        return sum(term.size for term in self.terms)

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
            setup = term.apply(setup, value)
        return setup

    def setup_at(self, u: np.ndarray) -> Setup:
        """The setup at search variables u (P,)."""
        parts = zip(self.terms, self.split(u), strict=True)
        return self.setup([torch.from_numpy(term.value(part)) for term, part in parts])

    def conditions_at(self, u: np.ndarray) -> Conditions:
        """What holds the ends at search variables u (P,)."""
        setup = self.setup_at(u)
        return Conditions(setup.ends, setup.clamp)

    def at(self, u: np.ndarray, start: Solution | None = None) -> Point:
        """Settle at u. Frames that do not converge are NaN in `seen`."""
        setup = self.setup_at(u)
        conditions = Conditions(setup.ends, setup.clamp)
        start = start or self.last
        rod = setup.rod()
        if rod.load.ndim == 3:
            rod = rod.each(len(rod.load))
        if setup.potentials:
            solution, conditions, rod = solve_with_potentials(
                rod, conditions, setup.potentials, start
            )
        else:
            solution = solve(rod, conditions, start)
            retry = ~solution.converged
            if retry.any() and start is not None:  # from the catenaries
                again = solve(rod, conditions)
                solution.put(retry, again, retry)
        if solution.converged.all():
            self.last = solution
        seen = setup.seen(torch.from_numpy(solution.x)).numpy().copy()
        seen[~solution.converged] = np.nan
        return Point(u, setup, rod, conditions, solution, seen)

    def jacobian(self, point: Point) -> np.ndarray:
        """(P, F, K, 3) derivative of `seen` in the search variables."""
        parts = self.split(point.u)
        primal = [torch.from_numpy(t.value(u)) for t, u in zip(self.terms, parts, strict=True)]
        changes = []
        for number, (term, u) in enumerate(zip(self.terms, parts, strict=True)):
            for direction in np.diag(term.slope(u)):
                changes.append(self._change(primal, number, torch.from_numpy(direction)))
        return respond(point, changes)

    def _change(self, primal: list[Tensor], number: int, direction: Tensor) -> Change:
        def changed() -> Setup:
            values = list(primal)
            values[number] = forward_ad.make_dual(primal[number], direction)
            return self.setup(values)

        return changed


def change_by(setup: Setup, term: Term, k: int) -> Change:
    """A further term's k-th value on top of a setup, from the term's start."""
    value = torch.from_numpy(term.start)
    direction = torch.from_numpy(np.eye(term.size)[k] * term.slope(np.zeros(term.size))[k])

    def changed() -> Setup:
        return term.apply(setup, forward_ad.make_dual(value, direction))

    return changed


def respond(point: Point, changes: list[Change]) -> np.ndarray:
    """(P, F, K, 3) first-order changes of the nodes as seen at a point, for P changed setups."""
    if not changes:
        return np.zeros((0, *point.seen.shape))
    x = torch.from_numpy(point.solution.x)
    rod, ends, clamp, direct, force = [], [], [], [], []
    for changed in changes:
        with forward_ad.dual_level():
            setup = changed()
            rod.append([tangent_of(t) for t in setup.rod()])
            ends.append(tangent_of(setup.ends))
            clamp.append(turn_of(setup.clamp))
            direct.append(tangent_of(setup.seen(x)))
            force.append(springs(setup.potentials, x))
    fields = [np.stack([row[i] for row in rod]) for i in range(6)]
    rods, frames = point.rod, len(x)
    by_frame = fields[4].ndim == 4  # loads that differ from frame to frame, (P, F, N+1, 3)
    load = np.moveaxis(fields[4], 1, 0) if by_frame else None
    if any(f is not None for f in force):  # as do a potential's forces
        pushed = np.stack([0.0 * x.numpy() if f is None else f for f in force], axis=1)
        load = (fields[4] if load is None else load) + pushed
    if load is not None:
        rods = rods.each(frames)
    if rods.length.ndim == 1:
        fields = [f[None] for f in fields]
    else:
        fields = [
            load if k == 4 and load is not None else np.broadcast_to(f, (frames, *f.shape))
            for k, f in enumerate(fields)
        ]
    directions = Directions(
        *fields,
        ends=np.nan_to_num(np.stack(ends, axis=1)),
        clamp=np.nan_to_num(np.stack(clamp, axis=1)),
    )
    dx, _ = tangent(rods, point.conditions, point.solution, directions)
    # The sensor's small errors move a change of the rope by a change of second order only.
    return np.moveaxis(dx, 1, 0) + np.stack(direct)


def tangent_of(t: Tensor) -> np.ndarray:
    """The tangent of a dual tensor, zeros where it has none."""
    tangent_ = forward_ad.unpack_dual(t).tangent
    return np.zeros(tuple(t.shape)) if tangent_ is None else tangent_.numpy().copy()


def turn_of(clamp: Tensor) -> np.ndarray:
    """(F, 2, 3) the tangent of frames as turns about their own axes."""
    primal, tangent_ = forward_ad.unpack_dual(clamp)
    if tangent_ is None:
        return np.zeros((*clamp.shape[:-1], 3))
    return 2 * conjugate_product(primal, tangent_)[..., 1:].numpy()
