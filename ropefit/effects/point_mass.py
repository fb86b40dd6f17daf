"""A small mass on the rope: a knot, a clip, a marker, a gland."""

from __future__ import annotations

from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.place import at_point
from ropefit.rod.setup import Setup


class PointMass(Effect):
    """Weight of `mass` [kg] at an arc length, shared by the nodes beside it."""

    name = "point_mass"
    locus = "point"
    quantities = (Quantity("mass", "kg", 0.003, lower=0.0, by_weight=1.0),)

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        share = at_point(setup.arc, values[1])
        return setup._replace(load=setup.load + values[0] * share[:, None] * setup.gravity)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"a mass of {values['mass'] * 1e3:.3g} g sits on the rope at "
            f"{values['arc_length']:.3f} m"
        )
