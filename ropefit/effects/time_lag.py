"""Ends that were recorded by another clock than the rope."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup


class TimeLag(Effect):
    """The ends are recorded `lag` [s] late: their true pose is the one recorded `lag` later."""

    name = "time_lag"
    kind = "measurement"
    quantities = (Quantity("lag", "s", 0.02, -0.3, 0.3),)
    calibration = Calibration("clock", ("lag",), "time_lag", own_sensor=True)

    def applies(self, setup: Setup) -> bool:
        return setup.motion is not None and bool((setup.motion.end_velocity != 0).any())

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        assert setup.motion is not None
        m, lag = setup.motion, values[0]
        ends = setup.ends + lag * m.end_velocity + 0.5 * lag**2 * m.end_acceleration
        clamp = multiply(setup.clamp, from_rotation_vector(lag * m.clamp_rate))
        return setup._replace(ends=ends, clamp=clamp)

    def sentence(self, values: dict[str, float]) -> str:
        late = "late" if values["lag"] > 0 else "early"
        return f"the ends are recorded {abs(values['lag']) * 1e3:.2g} ms too {late}"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clock")
