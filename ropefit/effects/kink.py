"""A sharp permanent bend at one place."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.intrinsic_curvature import twist_held
from ropefit.effects.place import at_point
from ropefit.rod.setup import Setup


class Kink(Effect):
    """A rest turn [rad] at an arc length, about the rope's own two directions across it."""

    name = "kink"
    locus = "point"
    vector = ("angle", "rad")
    quantities = (Quantity("angle_1", "rad", 0.15), Quantity("angle_2", "rad", 0.15))

    def applies(self, setup: Setup) -> bool:
        return twist_held(setup)

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        share = at_point(setup.arc, values[2])
        turn = torch.stack([values[0], values[1], torch.zeros_like(values[0])])
        return setup._replace(kinks=setup.kinks + share[:, None] * turn)

    def sentence(self, values: dict[str, float]) -> str:
        size = math.degrees(math.hypot(values.get("angle_1", 0), values.get("angle_2", 0)))
        return f"the rope is kinked by {size:.3g}° at {values['arc_length']:.3f} m"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("kink")


class FreeKink(Kink):
    """The same for a rope that is free to spin: only the size of the angle acts."""

    vector = None
    quantities = (Quantity("angle", "rad", 0.15, lower=0.0),)
    linear = False

    def applies(self, setup: Setup) -> bool:
        return not twist_held(setup)

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        zero = torch.zeros_like(values[:1])
        return super().apply(setup, torch.cat([values[:1], zero, values[1:]]))

    def sentence(self, values: dict[str, float]) -> str:
        return super().sentence({"angle_1": values["angle"], **values})
