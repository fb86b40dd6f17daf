"""A force that turns with the rope: a jet, a thruster, a hand that follows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import at_point
from ropefit.rod.setup import Follower, Setup, twist_held


class FollowerForce(Effect):
    """Force [N] at an arc length, constant in the rope's own frame: along its first two directors,
    which are across it, and along its tangent.

    Directors that turn freely about the tangent would carry a force that says nothing: a clamp must
    hold the rope's twist.
    """

    name = "follower_force"
    locus = "point"
    in_motion = False
    stands_for_others = True
    vector = ("force", "N")
    constant = "F = F0 in the rope's own frame"
    no_curve = (
        "the force acts at one place and is constant there in the rope's own frame: it has no "
        "variable; the alternative is a force that is constant in space (point_force)"
    )
    quantities = tuple(
        Quantity(name, "N", 0.03, by_weight=1.0) for name in ("across_1", "across_2", "along")
    )

    def applies(self, setup: Setup) -> bool:
        return twist_held(setup) and not setup.remembers

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        arc = setup.arc
        share = at_point(arc, values[3])
        middle = 0.5 * (arc[1:] + arc[:-1])
        weight = at_point(middle, np.maximum(values[3], middle[0]))
        follower = Follower(share, weight, values[:3])
        return setup._replace(followers=(*setup.followers, follower))

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        return Exported(beside, note="follower_force: no target has forces that turn with the rope")

    def sentence(self, values: dict[str, float]) -> str:
        across = math.hypot(values["across_1"], values["across_2"])
        return (
            f"a force that turns with the rope acts at {values['arc_length']:.3f} m, "
            f"{across:.3g} N across it and {values['along']:.3g} N along it"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("follower")
