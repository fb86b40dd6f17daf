"""Ropes in equilibrium that several tests use: in the plane of x and z, gravity along -z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.rod.rod import Rod
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve

DOWN = np.array([0.0, 0.0, -1.0])
NOT_HELD = np.full((1, 2, 4), np.nan)


def solved(rod: Rod, conditions: Conditions, **options) -> Solution:
    """The states, which must have converged."""
    solution = solve(rod, conditions, **options)
    assert solution.converged.all(), (solution.status, solution.residual)
    return solution


@dataclass(frozen=True)
class Order:
    """Errors at several numbers of segments, and the power of h that fits them."""

    segments: tuple[int, ...]
    errors: tuple[float, ...]

    @property
    def power(self) -> float:
        return -float(np.polyfit(np.log(self.segments), np.log(self.errors), 1)[0])

    def check(self, power: float = 2.0, slack: float = 0.3) -> None:
        assert abs(self.power - power) < slack, (self.power, self.errors)
