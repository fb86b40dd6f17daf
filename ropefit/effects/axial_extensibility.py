"""A rope that stretches under its own tension."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Derived, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.rod.setup import Setup

SMALLEST, LARGEST = 1e-300, 1e300  # 1/N, N: beyond, EA is no longer a number


def rigidity(compliance: float) -> float:
    """Return EA [N] of a compliance [1/N]."""
    return 1 / compliance if compliance > SMALLEST else LARGEST


class AxialExtensibility(Effect):
    """`compliance` 1/EA [1/N]: relative stretch per newton of tension."""

    name = "axial_extensibility"
    of_rope = True
    changes = False
    of_simulators = True
    implausible = 100.0  # twice as long under its own weight: a cord of rubber
    quantities = (
        Quantity(
            "compliance", "1/N", 0.01, lower=0.0, by_weight=-1.0,
            derived=Derived("EA", "N", rigidity),
        ),
    )  # fmt: skip

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return setup._replace(stretch=setup.stretch + values[0])

    def sentence(self, values: dict[str, float]) -> str:
        return f"the rope stretches by {100 * values['compliance']:.3g} % per newton of tension"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("spring")
