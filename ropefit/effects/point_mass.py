"""A small mass on the rope: a knot, a clip, a marker, a gland."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit import attachments as records
from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import at_point, nearest_node
from ropefit.rod.setup import Setup


class PointMass(Effect):
    """Weight of `mass` [kg] at an arc length, shared by the nodes beside it."""

    name = "point_mass"
    of_rope = True
    locus = "point"
    quantities = (Quantity("mass", "kg", 0.003, lower=0.0, by_weight=1.0),)
    confounding = (
        "shapes do not distinguish a heavier place from a softer rope: weigh it, or record the "
        "rope without and give that run as --nominal"
    )

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        share = at_point(setup.arc, values[1])
        return setup._replace(mass=setup.mass + values[0] * share)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        node = nearest_node(setup, values["arc_length"], nodes)
        return Exported((*beside, records.PointMass(node, values["mass"])))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"a mass of {values['mass'] * 1e3:.3g} g sits on the rope at "
            f"{values['arc_length']:.3f} m"
        )

    def unseen(self, size: float) -> tuple[str, str]:
        return "weight", f"A weight of {1e3 * size:.2g} g on the rope would have been noticed."

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("weight")
