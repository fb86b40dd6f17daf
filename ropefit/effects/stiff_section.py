"""A section that is stiffer than the rest: tape, a splice, a sleeve."""

from __future__ import annotations

import math

import numpy as np

from ropefit.effects.base import Derived, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import over_interval
from ropefit.rod.setup import Setup


def change_stiffness(
    setup: Setup, log_factor: np.ndarray, centre: np.ndarray, width: np.ndarray
) -> Setup:
    """Multiply EI and GJ by exp(log_factor) over an interval.

    A segment partly inside has its compliance mixed by length.
    """
    p = setup.properties
    inside = over_interval(setup.arc, centre, width)
    softer = 1 + inside * (np.exp(-log_factor) - 1)
    return setup._replace(properties=p._replace(bend=p.bend / softer, twist=p.twist / softer))


class StiffSection(Effect):
    """`log_factor`: logarithm of the rigidity inside an interval over that outside."""

    name = "stiff_section"
    of_rope = True
    locus = "interval"
    quantities = (
        Quantity(
            "log_factor", "1", 0.5, lower=0.0, upper=7.0,
            derived=Derived("factor", "1", lambda log: float(np.exp(log))),
        ),
    )  # fmt: skip

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return change_stiffness(setup, values[0], values[1], values[2])

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"{values['width']:.2f} m of rope about {values['centre']:.3f} m are "
            f"{math.exp(values['log_factor']):.3g} times as stiff as the rest"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        factor = float(np.exp(values["log_factor"]))
        return Drawn(size=factor, label=f"{factor:.2g} × as stiff")
