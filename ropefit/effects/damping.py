"""A rope that resists moving, by the air around it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.inertia import node_share
from ropefit.rod.setup import Setup


class Damping(Effect):
    """`air` [N s/m²]: force against the velocity, per length and speed."""

    name = "damping"
    quantities = (Quantity("air", "N s/m^2", 0.05, 0.0, by_weight=1.0, by_length=-1.0),)

    in_motion = False

    def applies(self, setup: Setup) -> bool:
        return setup.motion is not None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        assert setup.motion is not None
        share = node_share(setup, np.ones_like(setup.properties.length))
        return setup._replace(load=setup.load - values[0] * share[:, None] * setup.motion.velocity)

    def sentence(self, values: dict[str, float]) -> str:
        return f"the rope is slowed by {values['air']:.3g} N per metre of it and m/s"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("dashpot")


class DampingInMotion(Effect):
    """More damping of a rope that is simulated in motion: of the air, and of its own bending."""

    name = "damping"
    of_rope = True
    quantities = (
        Quantity("air", "N s/m^2", 0.05, 0.0, by_weight=1.0, by_length=-1.0),
        Quantity("bend", "N m^2 s", 3e-4, 0.0, by_weight=1.0, by_length=2.0),
    )

    def applies(self, setup: Setup) -> bool:
        return setup.damping is not None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        if setup.damping is None:  # a rope at rest is not damped
            return setup
        d, (air, bend) = setup.damping, values
        more = d._replace(air=d.air + air, bend=d.bend + bend, twist=d.twist + bend)
        return setup._replace(damping=more)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        air, bend = values["air"], values["bend"]
        note = f"damping: {air:.4g} N s/m^2 more by the air, {bend:.4g} N m^2 s more in bending"
        return Exported(beside, settles=False, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"the rope is damped more: by the air with {values['air']:.3g} N s/m², by its bending "
            f"with {values['bend']:.3g} N m² s"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("dashpot")
