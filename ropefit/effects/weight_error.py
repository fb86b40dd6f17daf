"""Everything weighs more or less than stated: a wrong mass, or a wrong gravity."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup


class WeightError(Effect):
    """Gravity is 1 + `excess` times what is stated. At rest a wrong mass does the same."""

    name = "weight_error"
    of_simulators = True
    kind = "measurement"
    quantities = (Quantity("excess", "1", 0.1, -0.9, 9.0),)
    implausible = np.inf  # masses are stated in wrong units: the bounds decide

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return setup._replace(gravity=setup.gravity * (1 + values[0]))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"everything weighs {1 + values['excess']:.3g} times what was stated: the mass of the "
            "rope or gravity is wrong"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        label = f"{1 + values['excess']:.3g} × as heavy"
        return Drawn("load", vector=gravity, label=label)
