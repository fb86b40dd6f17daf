"""A sharp permanent bend at one place."""

from __future__ import annotations

import math

import numpy as np

from ropefit.effects.base import Derived, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import around_point, points_along
from ropefit.rod.setup import Setup, twist_held

USUAL_WIDTH, WIDTH_SD = 0.006, 0.7  # of the length, and of its logarithm: as a rope is thick
INEXACT = 0.01  # relative error of angles on the segments that diagnoses use
# Of a wider bend that passes for a sharp one, the angle comes out too small, by some percent: what
# is not known of the width is in the interval of the angle.
WIDTH = Quantity(
    "log_width", "1", 0.3, derived=Derived("width", "m", lambda log: math.exp(min(log, 0.0)))
)


def log_width(setup: Setup) -> float:
    """Return the logarithm of the usual width [m]."""
    return math.log(USUAL_WIDTH * float(setup.properties.length.sum()))


class Kink(Effect):
    """A rest turn [rad] about the rope's own two directions across it, spread about an arc length
    over a width; `log_width`: logarithm of that in metres."""

    name = "kink"
    of_rope = True
    locus = "point"
    vector = ("angle", "rad")
    quantities = (
        Quantity("angle_1", "rad", 0.15, inexact=INEXACT),
        Quantity("angle_2", "rad", 0.15, inexact=INEXACT),
        WIDTH,
    )
    shaping = 1

    def applies(self, setup: Setup) -> bool:
        return twist_held(setup)

    def scan_places(self, setup: Setup) -> np.ndarray:
        places = points_along(setup)
        return np.hstack([np.full_like(places, log_width(setup)), places])

    def start_sd(self, setup: Setup) -> np.ndarray:
        """Hold the width near the usual one, unless the data tell it."""
        return np.array([*(math.inf for _ in self.names[:-2]), WIDTH_SD, math.inf])

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        share = around_point(setup.arc, values[3], np.exp(values[2]))
        turn = np.append(values[:2], 0.0)
        return setup._replace(kinks=setup.kinks + share[:, None] * turn)

    def sentence(self, values: dict[str, float]) -> str:
        size = math.degrees(math.hypot(values.get("angle_1", 0), values.get("angle_2", 0)))
        return f"the rope is kinked by {size:.3g}° at {values['arc_length']:.3f} m"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("kink")


class FreeKink(Kink):
    """The same for a rope that is free to spin: only the size of the angle acts."""

    vector = None
    quantities = (Quantity("angle", "rad", 0.15, lower=0.0, inexact=INEXACT), WIDTH)
    linear = False
    turns_rope = True

    def applies(self, setup: Setup) -> bool:
        return not twist_held(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return super().apply(setup, np.insert(values, 1, 0.0))

    def sentence(self, values: dict[str, float]) -> str:
        return super().sentence({"angle_1": values["angle"], **values})
