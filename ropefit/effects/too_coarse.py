"""Shapes that look like those of a simulation with too few nodes."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.coarse_error import COARSENING, CoarseError

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
        return setup._replace(solver_error=CoarseError.of(setup, float(values[0])))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the shapes are those of a simulation with segments "
            f"{COARSENING * max(values['amount'], 0) ** 0.5:.2g} times as long as ours"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("mesh")
