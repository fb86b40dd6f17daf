"""Ends that were recorded by another clock than the rope."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.quaternion import multiply
from ropefit.rod.setup import Setup

USUAL_SHARE = 0.1  # of the time between frames: a usual lag, where frames are few
LONG = 0.1  # s: reported in seconds
LARGEST = 0.3  # s; more than the time between two frames only where they are dense


class _Lag(Quantity):
    """A time [s] whose usual size grows with the time between frames."""

    def size(self, setup: Setup) -> float:
        return (
            self.scale
            if setup.end_path is None
            else max(self.scale, USUAL_SHARE * setup.end_path.step)
        )


class TimeLag(Effect):
    """The ends are recorded `lag` [s] late: their true pose is the one recorded `lag` later."""

    name = "time_lag"
    kind = "measurement"
    quantities = (_Lag("lag", "s", 0.02),)
    calibration = Calibration("clock", ("lag",), "time_lag", own_sensor=True)

    def applies(self, setup: Setup) -> bool:
        return setup.end_path is not None

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        most = LARGEST if setup.end_path is None else max(LARGEST, setup.end_path.step)
        return [-most], [most]

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        if setup.end_path is None:  # poses that are held still have no lag
            return setup
        shift, turn = setup.end_path.moved(values[0])
        return setup._replace(
            ends=setup.ends + shift,
            clamp=multiply(setup.clamp, turn),
            end_path=setup.end_path.later(values[0]),  # a further lag begins there
        )

    def begun_before(self, setup: Setup, x: np.ndarray) -> np.ndarray:
        """Return (F,) bool: frames whose true pose of the ends lies outside the path recorded."""
        if setup.end_path is None:
            return np.zeros(len(x), dtype=bool)
        return setup.end_path.outside(USUAL_SHARE * setup.end_path.step)

    def sentence(self, values: dict[str, float]) -> str:
        return f"the ends are recorded {_late(values['lag'], 'too ')}"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clock", label=_late(values["lag"]))


def _late(lag: float, too: str = "") -> str:
    size = abs(lag)
    time = f"{size:.3g} s" if size >= LONG else f"{1e3 * size:.2g} ms"
    return f"{time} {too}{'late' if lag > 0 else 'early'}"
