"""The error of a simulation with too few nodes, with its exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ropefit.rod.differences import slope, turn_slope
from ropefit.rod.rod import Properties, Rod
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve

COARSENING = 4  # of the segment length


@dataclass(frozen=True)
class CoarseError:
    """`amount` of the difference between a rod of a quarter of the segments, interpolated, and the
    fine one, under the same conditions and dead loads. Solved when it is asked for."""

    amount: float
    fine: Rod
    coarse: Rod
    held: Conditions

    @classmethod
    def of(cls, setup: Setup, amount: float) -> CoarseError:
        """Return the error of a setup's rod, without what acts by its state."""
        fine, coarse = setup.rod(), coarsened(setup).rod()
        if fine.load.ndim == 3:
            fine, coarse = (rod.each(len(setup.ends)) for rod in (fine, coarse))
        return cls(amount, fine, coarse, Conditions(setup.ends, setup.clamp))

    def frames(self, index: np.ndarray) -> CoarseError:
        """Return the error in some of the frames."""
        fine, coarse = (rod.frames(index) for rod in (self.fine, self.coarse))
        return replace(self, fine=fine, coarse=coarse, held=self.held.frames(index))

    @cached_property
    def _solved(self) -> tuple[Solution, Solution]:
        return solve(self.fine, self.held), solve(self.coarse, self.held)

    @cached_property
    def unit(self) -> np.ndarray:
        """Return (F, N+1, 3) [m] the nodes of the coarse rod, interpolated, minus the fine ones."""
        fine, coarse = self._solved
        return _interpolated(coarse.x, fine.x.shape[1]) - fine.x

    @property
    def move(self) -> np.ndarray:
        """Return (F, N+1, 3) [m] by how much the error moves the nodes."""
        return self.amount * self.unit

    def slope(self, a: CoarseError, b: CoarseError) -> np.ndarray:
        """Return (F, N+1, 3) the derivative of `move` where the error goes from a to b, a central
        difference about this one."""
        out = slope(a.amount, b.amount) * self.unit
        by_fine, by_coarse = (
            _response(s, *pair, a.held, b.held)
            for s, pair in zip(self._solved, ((a.fine, b.fine), (a.coarse, b.coarse)), strict=True)
        )
        if by_fine is not None and by_coarse is not None:
            out = out + self.amount * (_interpolated(by_coarse, by_fine.shape[1]) - by_fine)
        return out


def _response(
    s: Solution, low: Rod, high: Rod, before: Conditions, after: Conditions
) -> np.ndarray | None:
    """Return (F, N+1, 3) how a solution's nodes move with its rod and ends; None if none moves."""
    fields = [np.zeros_like(p) if p is q else slope(p, q) for p, q in zip(low, high, strict=True)]
    ends = slope(before.ends, after.ends)
    clamp = turn_slope(s.conditions.clamp, before.clamp, after.clamp)
    if not any(change.any() for change in (*fields, ends, clamp)):
        return None
    many = s.rod.length.ndim == 2  # ropes: a row for each
    rows = [(change if many else change[None])[:, None] for change in fields]
    moved = tangent(s, Directions(*rows, ends=ends[:, None], clamp=clamp[:, None]))
    return moved[0][:, 0]


def coarsened(setup: Setup) -> Setup:
    """Return the setup with a rod of a quarter of the segments; what is on a node is shared by the
    nodes next to it. What acts by the rope's state stays that of the fine one."""
    many = setup.segments // COARSENING
    wide = setup.segments / many
    inside = ((np.arange(many * COARSENING) + 0.5) * (wide / COARSENING)).astype(int)

    def mean(values: np.ndarray) -> np.ndarray:
        return values[inside].reshape(many, COARSENING, *values.shape[1:]).mean(axis=1)

    low, share = _places(setup.segments, many)

    def shared(values: np.ndarray, axis: int) -> np.ndarray:
        values = np.moveaxis(values, axis, 0)
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        out = np.zeros((many + 1, *values.shape[1:]))
        np.add.at(out, low, (1 - part) * values)
        np.add.at(out, low + 1, part * values)
        return np.moveaxis(out, 0, axis)

    few = Properties(*map(mean, setup.properties))
    return setup._replace(
        properties=few._replace(length=wide * few.length),
        load=shared(setup.load, -2),
        mass=shared(setup.mass, 0),
        kinks=shared(setup.kinks, 0),
        stretch=mean(setup.stretch),
        rigid=None if setup.rigid is None else mean(setup.rigid),
    )


def _places(segments: int, many: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (N+1,) before which coarse node each fine one lies, and how far beyond it."""
    at = np.arange(segments + 1) * (many / segments)
    low = np.minimum(at.astype(int), many - 1)
    return low, at - low


def _interpolated(x: np.ndarray, nodes: int) -> np.ndarray:
    """Return (F, nodes, 3) on a cubic through the coarse nodes x (F, n+1, 3), as the data are
    compared with a smooth curve."""
    low, share = _places(nodes - 1, x.shape[1] - 1)
    share = share[:, None]
    beyond = np.concatenate(
        [
            3 * x[:, :1] - 3 * x[:, 1:2] + x[:, 2:3],
            x,
            3 * x[:, -1:] - 3 * x[:, -2:-1] + x[:, -3:-2],
        ],
        axis=1,
    )
    a, b, c, d = (beyond[:, low + k] for k in range(4))
    return b + 0.5 * share * (
        c - a + share * (2 * a - 5 * b + 4 * c - d + share * (3 * (b - c) + d - a))
    )
