"""Ropes in equilibrium that several tests use: in the plane of x and z, gravity along -z."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.references import Guess, Planar
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.conditions import Conditions
from ropefit.solvers.equilibrium import Solution, solve

DOWN = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)
NOT_HELD = torch.full((1, 2, 4), torch.nan, dtype=torch.float64)


def upright(angle: float) -> Tensor:
    """(4,) frame whose third director is (cos θ, 0, sin θ): turned about y."""
    half = 0.5 * (math.pi / 2 - angle)
    return torch.tensor([math.cos(half), 0.0, math.sin(half), 0.0], dtype=torch.float64)


def planar(p: Planar, segments: int, density: float = 1.0) -> tuple[Rod, Conditions]:
    """The discrete rope of a planar reference, one frame; its weight is density times gravity."""
    clamped = (p.first is not None, p.last is not None)
    properties = uniform(
        length=p.length,
        segments=segments,
        bend=p.bend,
        axial=p.axial,
        shear=p.shear,
        density=density,
        # A turn about y lowers θ.
        curvature=(0.0, -p.curvature, 0.0),
    )
    rod = build(properties, DOWN * p.weight / density, clamped)
    load, moment = rod.load.clone(), rod.moment.clone()
    load[-1] += torch.tensor([p.force[0], 0.0, p.force[1]])
    moment[1, 1] = -p.moment
    ends = torch.zeros(1, 2, 3, dtype=torch.float64)
    ends[0, 1] = torch.nan
    if p.far is not None:
        ends[0, 1] = torch.tensor([p.far[0], 0.0, p.far[1]])
    clamp = NOT_HELD.clone()
    for end, angle in enumerate((p.first, p.last)):
        if angle is not None:
            clamp[0, end] = upright(angle)
    return rod._replace(load=load, moment=moment), Conditions(ends, clamp)


def solved(rod: Rod, conditions: Conditions, **options) -> Solution:
    """The states, which must have converged."""
    solution = solve(rod, conditions, **options)
    assert solution.converged.all(), (solution.status, solution.residual)
    return solution


def guess_of(rod: Rod, solution: Solution) -> Guess:
    """Start of a reference solution: only the branch and speed depend on it, not the answer."""
    arc, x, n = rod.arc.numpy(), solution.x[0], solution.force[0]
    edge = np.diff(x, axis=0)
    angle = np.unwrap(np.arctan2(edge[:, 2], edge[:, 0]))
    middle = 0.5 * (arc[1:] + arc[:-1])
    weight = np.array([0.0, (n[1:] - n[:-1])[:, 2].mean() * len(n) / arc[-1]])
    force = n[0, [0, 2]] - weight * middle[0]
    return Guess(arc, np.interp(arc, middle, angle), x[:, 0], x[:, 2], force)


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
