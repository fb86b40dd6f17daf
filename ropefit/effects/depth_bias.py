"""A depth sensor that reports points too far or too near."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup


class DepthBias(Effect):
    """Points are reported `offset` [m] too far along their ray."""

    name = "depth_bias"
    kind = "measurement"
    quantities = (Quantity("offset", "m", 0.005, -0.2, 0.2),)
    calibration = Calibration("surface", ("depth",), "surface")

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        sensor = setup.sensor
        return setup._replace(sensor=sensor._replace(depth=sensor.depth + values[0]))

    def sentence(self, values: dict[str, float]) -> str:
        return f"the sensor reports the rope {values['offset'] * 1e3:+.2g} mm off along its rays"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("camera", label=f"depth {1e3 * values['offset']:+.2g} mm")


class DepthGain(Effect):
    """Distances from the sensor are reported 1 + `gain` times too large."""

    name = "depth_bias"
    kind = "measurement"
    quantities = (Quantity("gain", "1", 0.01, -0.3, 0.3),)
    calibration = Calibration("depth_gain", ("gain",), "depth_gain", own_sensor=True)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        sensor = setup.sensor
        return setup._replace(sensor=sensor._replace(gain=sensor.gain + values[0]))

    def sentence(self, values: dict[str, float]) -> str:
        return f"the sensor's depths are {100 * values['gain']:+.2g} % off"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("camera", label=f"depth {100 * values['gain']:+.2g} %")
