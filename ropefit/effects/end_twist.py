"""A clamp that is turned about the rope's own axis, or a rope twisted between its clamps."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.ends import turned_clamp
from ropefit.rod.setup import Setup


class EndTwist(Effect):
    """`angle` [rad]: twist between the two clamps besides the recorded one."""

    name = "end_twist"
    locus = "end"
    calibrated = True
    quantities = (Quantity("angle", "rad", 0.5),)

    def applies(self, setup: Setup) -> bool:
        held = bool(np.isfinite(setup.clamp_compliance[:, 1]).all())
        return self.end == 1 and all(setup.clamped) and held

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return turned_clamp(setup, self.end, np.append([0.0, 0.0], values))

    def sentence(self, values: dict[str, float]) -> str:
        return f"the rope is twisted by {values['angle'] * 57.2958:.3g}° more than recorded"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("turn")
