"""Internal friction that builds up exponentially with the change of bending (Dahl)."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect
from ropefit.effects.bending_hysteresis import BendingHysteresis
from ropefit.effects.friction_law import dahl, with_friction
from ropefit.effects.misfit import Misfit
from ropefit.rod.setup import Setup

USUAL = (1.25, 1.5)  # moment and range over those of the friction that slides, fitted to it


class GradualFriction(BendingHysteresis):
    """Friction that approaches a `moment` [N m] exponentially, over a `range` [1/m] of curvature.

    It is compared where friction that slides leads and leaves a remainder, which another cause
    would be taken for.
    """

    scanned = False
    builds_up = "Dahl"

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return with_friction(setup, dahl(values[0], values[1]))

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose the friction that a sliding one was fitted to."""
        return [[values * USUAL]] if type(leader) is BendingHysteresis else []

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"friction inside the rope resists a change of its bending by {values['moment']:.2g} "
            f"N m, two thirds of it after a change of curvature by {values['range']:.2g} 1/m"
        )
