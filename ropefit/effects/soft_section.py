"""A section that is softer than the rest: wear, broken strands."""

from __future__ import annotations

import math

import numpy as np

from ropefit.effects.base import Derived, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.stiff_section import change_stiffness
from ropefit.rod.setup import Setup


class SoftSection(Effect):
    """`log_factor`: logarithm of the rigidity outside an interval over that inside."""

    name = "soft_section"
    of_rope = True
    locus = "interval"
    quantities = (
        Quantity(
            "log_factor", "1", 0.5, lower=0.0, upper=7.0,
            derived=Derived("factor", "1", lambda log: float(np.exp(-log))),
        ),
    )  # fmt: skip

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return change_stiffness(setup, -values[0], values[1], values[2])

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"{values['width']:.2f} m of rope about {values['centre']:.3f} m are "
            f"{math.exp(-values['log_factor']):.3g} times as stiff as the rest"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        factor = float(np.exp(-values["log_factor"]))
        return Drawn(size=factor, label=f"{factor:.2g} × as stiff")
