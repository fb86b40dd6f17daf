"""Gravity does not point where the recording says."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Calibration, Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import horizontal
from ropefit.rod.setup import Setup


class GravityMisalignment(Effect):
    """Gravity is turned by two angles [rad] about the horizontal axes."""

    name = "gravity_misalignment"
    kind = "measurement"
    vector = ("angle", "rad")
    quantities = (Quantity("angle_1", "rad", 0.02, -1, 1), Quantity("angle_2", "rad", 0.02, -1, 1))
    calibration = Calibration("gravity", ("x", "y"), "gravity", degrees=True)

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        first, second = horizontal(setup.gravity)
        turn, g = values[0] * first + values[1] * second, setup.gravity
        turned = g + torch.linalg.cross(turn, g) - 0.5 * (turn * turn).sum() * g
        return setup._replace(gravity=turned)

    def sentence(self, values: dict[str, float]) -> str:
        size = (values["angle_1"] ** 2 + values["angle_2"] ** 2) ** 0.5
        return f"gravity points {size * 57.2958:.2g}° away from its recorded direction"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        first, second = (axis.numpy() for axis in horizontal(torch.tensor(gravity)))
        turn = values["angle_1"] * first + values["angle_2"] * second
        return Drawn("gravity", vector=gravity + np.cross(turn, gravity))
