"""A rope whose length is not the one stated."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup


class LengthError(Effect):
    """The rope between its ends is 1 + `excess` times as long as stated, the same everywhere.

    Of a rope in motion only: at rest a scale error, stretch and misplaced ends look alike.
    """

    name = "length_error"
    kind = "measurement"
    quantities = (Quantity("excess", "1", 0.01, -0.2, 0.2),)

    def applies(self, setup: Setup) -> bool:
        return setup.damping is not None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p = setup.properties
        return setup._replace(properties=p._replace(length=p.length * (1 + values[0])))

    def sentence(self, values: dict[str, float]) -> str:
        longer = "longer" if values["excess"] > 0 else "shorter"
        return f"the rope is {100 * abs(values['excess']):.2g} % {longer} than stated"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("ruler", label=f"length {100 * values['excess']:+.2g} %")
