"""A rope whose unloaded shape is a curve in space, as of cables that were coiled."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.intrinsic_curvature import twist_held
from ropefit.effects.place import QUARTERS, between_quarters
from ropefit.rod.setup import Setup


class RestShape(Effect):
    """Rest curvature [1/m] that varies along the whole rope, about its two directions across."""

    name = "rest_curve"
    of_rope = True
    vector = ("curvature", "1/m")
    quantities = tuple(
        Quantity(f"curvature_{axis}_at_{place}", "1/m", 0.5, by_length=-1.0)
        for axis in (1, 2)
        for place in QUARTERS
    )

    def applies(self, setup: Setup) -> bool:
        return setup.damping is not None and twist_held(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p = setup.properties
        across = between_quarters(setup) @ values.reshape(2, len(QUARTERS)).T
        turn = np.pad(across, [(0, 0), (0, 1)])
        return setup._replace(properties=p._replace(curvature=p.curvature + turn))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the unloaded rope is curved, differently along its length, with radii down to "
            f"{_radius(values):.2g} m"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        radius = _radius(values)
        return Drawn("arc", size=radius, label=f"radius down to {radius:.2g} m")


def _radius(values: dict[str, float]) -> float:
    """Return the least radius [m] of the unloaded rope."""
    most = max(
        (values[f"curvature_1_at_{p}"] ** 2 + values[f"curvature_2_at_{p}"] ** 2) ** 0.5
        for p in QUARTERS
    )
    return 1 / max(most, 1e-9)
