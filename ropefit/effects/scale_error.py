"""A scale error of all coordinates, those of the ends included: wrong units, a wrong ruler."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup


class ScaleError(Effect):
    """Recorded coordinates are 1 + `scale` times the true ones."""

    name = "scale_error"
    kind = "measurement"
    quantities = (Quantity("scale", "1", 0.01, -0.3, 0.3),)
    calibration = Calibration("scale", ("scale",), "scale")

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        sensor, v = setup.sensor, values[0]
        # About the origin of the coordinates, not about the sensor.
        sensor = sensor._replace(gain=sensor.gain + v, shift=sensor.shift + v * sensor.place)
        return setup._replace(ends=setup.ends / (1 + v), sensor=sensor)

    def sentence(self, values: dict[str, float]) -> str:
        return f"the recorded coordinates are {100 * values['scale']:+.2g} % off in scale"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("ruler", label=f"scale {100 * values['scale']:+.2g} %")
