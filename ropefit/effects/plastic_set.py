"""Plastic set: bent too far, a rope keeps a part of the bend."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.revisit import revisits
from ropefit.rod.memory import Branch
from ropefit.rod.setup import Setup


class PlasticSet(Effect):
    """`share` of the bending rigidity that yields where the curvature exceeds `yield_curvature`
    [1/m]: beyond it the rope is that much softer, and when it is let go this share of the excess
    stays as rest curvature. In the first frame the rope has its rest shape."""

    name = "plastic_set"
    in_motion = False
    quantities = (
        Quantity("share", "1", 0.2, 0.0, 0.95),
        Quantity("yield_curvature", "1/m", 3.0, 1e-3, 1e3, by_length=-1.0),
    )
    linear = False
    path_dependent = True
    shaping = 1
    looks_like_noise = True
    tries = (0.4, 1.0, 2.5, 6.0, 12.0)  # next to a clamp a rope bends many times as much

    def applies(self, setup: Setup) -> bool:
        return revisits(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p, share = setup.properties, values[0]
        never = np.array(np.inf)
        # The rod's elastic part is reduced; the sum is the rigidity of a rope that has not yielded.
        branch = Branch(share * p.bend, values[1], never, fresh=True)
        return setup._replace(
            properties=p._replace(bend=(1 - share) * p.bend), memory=(*setup.memory, branch)
        )

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"bent to a radius below {1 / values['yield_curvature']:.2g} m the rope yields, and "
            f"{100 * values['share']:.2g} % of the excess stays in it as a set"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("loop")
