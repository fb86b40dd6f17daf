"""Internal friction: strands that rub when a rope is bent to and fro."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np

from ropefit.attachments import BendingFriction
from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.friction_law import friction_law, prandtl, with_friction
from ropefit.effects.law import Law
from ropefit.effects.revisit import revisits
from ropefit.rod.setup import Setup


class BendingHysteresis(Effect):
    """A friction element in series with a spring: a `moment` [N m] to be overcome whenever the
    bending reverses, and the `range` [1/m] of curvature over which it builds up. None acts in the
    first frame."""

    name = "bending_hysteresis"
    in_motion = False
    quantities = (
        Quantity("moment", "N m", 3e-4, 0.0, by_weight=1.0, by_length=1.0),
        Quantity("range", "1/m", 1.0, 1e-3, 1e3, by_length=-1.0),
    )
    linear = False
    path_dependent = True
    changes = False
    shaping = 1
    looks_like_noise = True
    tries = (0.3, 2.0, 10.0)
    builds_up: ClassVar[Literal["Prandtl", "Dahl"]] = "Prandtl"

    def applies(self, setup: Setup) -> bool:
        return revisits(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return with_friction(setup, prandtl(values[0], values[1]))

    def law(self, setup: Setup) -> Law:
        return friction_law(setup, np.array([q.size(setup) for q in self.quantities]))

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        if values["moment"] <= 0:
            return Exported(beside, settles=False)
        friction = BendingFriction(values["moment"], values["range"], self.builds_up)
        return Exported((*beside, friction), settles=False)

    def exported_form(
        self, form: str, constants: dict[str, float], beside: tuple[Any, ...]
    ) -> Exported | None:
        if not form.startswith("Dahl") or constants["M0"] <= 0:
            return None
        friction = BendingFriction(constants["M0"], constants["k0"], "Dahl")
        return Exported((*beside, friction), settles=False)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"friction inside the rope resists a change of its bending by {values['moment']:.2g} "
            f"N m, fully after a change of curvature by {values['range']:.2g} 1/m"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("loop")
