"""An end that holds the rope's direction although it was assumed pinned, or a misaligned clamp."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity, one_end, turned_clamp, where
from ropefit.effects.drawn import Drawn, components
from ropefit.rod.quaternion import smallest_rotation
from ropefit.rod.setup import Setup


class ClampedEnd(Effect):
    """A pinned end with an elastic clamp: `stiffness` [N m/rad], to a direction fixed in space.

    The three values are that direction (from end 0 towards end 1) times the stiffness, so that an
    end without a clamp is zero; a rigid clamp is a large stiffness.
    """

    name = "clamped_end"
    locus = "end"
    vector = ("stiffness", "N m/rad")
    quantities = tuple(
        Quantity(f"stiffness_{axis}", "N m/rad", 0.003, by_weight=1.0, by_length=1.0)
        for axis in "xyz"
    )

    @property
    def tangent(self) -> bool:
        return False  # at zero stiffness the direction has no derivative

    def applies(self, setup: Setup) -> bool:
        free = bool(torch.isnan(setup.ends[:, self.end]).any())
        return not setup.clamped[self.end] and not free

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        size = torch.sqrt((values * values).sum() + 1e-30)
        up = torch.tensor([0.0, 0.0, 1.0], dtype=values.dtype)
        frame = smallest_rotation(up, values / size)
        wide = torch.zeros(2, 1, dtype=torch.bool)
        wide[self.end] = True
        clamp = torch.where(wide, frame, setup.clamp)
        # The spring bends only: pinned ends let the rope spin.
        bend = one_end(self.end, 1 / size)
        loose = one_end(self.end, torch.full_like(size, torch.inf))
        clamped = tuple(True if e == self.end else c for e, c in enumerate(setup.clamped))
        return setup._replace(
            clamp=clamp,
            clamp_compliance=setup.clamp_compliance + torch.stack([bend, loose], dim=-1),
            clamped=clamped,  # type: ignore[arg-type]
        )

    def sentence(self, values: dict[str, float]) -> str:
        size = sum(values[f"stiffness_{axis}"] ** 2 for axis in "xyz") ** 0.5
        return f"{where(self.end)} holds the rope's direction, with {size:.3g} N·m per radian"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clamp", vector=components(values, "stiffness_"))


class TiltedClamp(Effect):
    """A clamp misaligned with its recorded direction: a turn [rad] about two axes across it."""

    name = "clamped_end"
    locus = "end"
    vector = ("tilt", "rad")
    calibrated = True
    quantities = (Quantity("tilt_1", "rad", 0.05), Quantity("tilt_2", "rad", 0.05))

    @property
    def tangent(self) -> bool:
        return False  # usual tilts bend the rope out of proportion

    def applies(self, setup: Setup) -> bool:
        return setup.clamped[self.end]

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        turn = torch.cat([values, torch.zeros_like(values[:1])])
        return turned_clamp(setup, self.end, turn)

    def sentence(self, values: dict[str, float]) -> str:
        size = (values["tilt_1"] ** 2 + values["tilt_2"] ** 2) ** 0.5
        return (
            f"the clamp at {where(self.end)} points {size * 57.2958:.3g}° away from the recorded "
            "direction"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clamp")
