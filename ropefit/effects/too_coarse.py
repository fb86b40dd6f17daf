"""Shapes that look like those of a simulation with too few nodes."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.rod import Properties
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve

COARSENING = 4  # of the segment length
FEWEST_SEGMENTS = 16


class TooCoarse(Effect):
    """`amount` of the difference between a rod of a quarter of the segments and this one.

    The error grows with the square of the segment length, so an amount a stands for segments
    4 √a times as long.
    """

    name = "too_coarse"
    of_simulators = True
    kind = "solver"
    in_motion = False
    quantities = (Quantity("amount", "1", 0.5, 0.0, 60.0),)

    def applies(self, setup: Setup) -> bool:
        return setup.segments >= FEWEST_SEGMENTS

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        drift = setup.sensor.drift + values[0] * coarse_error(setup)
        return setup._replace(sensor=setup.sensor._replace(drift=drift))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the shapes are those of a simulation with segments "
            f"{COARSENING * max(values['amount'], 0) ** 0.5:.2g} times as long as ours"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("mesh")


def coarse_error(setup: Setup) -> np.ndarray:
    """Return (F, N+1, 3) [m] nodes of the coarse rod, interpolated, minus those of the fine one."""
    many = setup.segments // COARSENING
    nodes, wide = many + 1, setup.segments / many
    inside = ((np.arange(many * COARSENING) + 0.5) * (wide / COARSENING)).astype(int)

    def mean(values: np.ndarray) -> np.ndarray:
        return values[inside].reshape(many, COARSENING, *values.shape[1:]).mean(axis=1)

    few = Properties(*map(mean, setup.properties))
    few = few._replace(length=wide * few.length)
    coarse = setup._replace(
        properties=few,
        load=np.zeros((nodes, 3)),
        mass=np.zeros(nodes),
        kinks=np.zeros((nodes, 3)),
        stretch=mean(setup.stretch),
        rigid=None if setup.rigid is None else mean(setup.rigid),
        potentials=(),
    )
    held = Conditions(setup.ends, setup.clamp)
    fine = solve(setup._replace(potentials=()).rod(), held).x
    rough = solve(coarse.rod(), held).x
    at = np.arange(setup.segments + 1) / wide
    low = np.minimum(at.astype(int), nodes - 2)
    share = (at - low)[:, None]
    # A cubic through the coarse nodes, as the data are compared with a smooth curve.
    beyond = np.concatenate(
        [
            3 * rough[:, :1] - 3 * rough[:, 1:2] + rough[:, 2:3],
            rough,
            3 * rough[:, -1:] - 3 * rough[:, -2:-1] + rough[:, -3:-2],
        ],
        axis=1,
    )
    a, b, c, d = (beyond[:, low + k] for k in range(4))
    curve = b + 0.5 * share * (
        c - a + share * (2 * a - 5 * b + 4 * c - d + share * (3 * (b - c) + d - a))
    )
    return curve - fine
