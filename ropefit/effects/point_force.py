"""A steady force on one place of the rope: a hand, a magnet far away."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect, Exported, Quantity, SpecialCase
from ropefit.effects.place import at_point, horizontal
from ropefit.effects.point_mass import PointMass
from ropefit.rod.setup import Setup


def hanging_mass(setup: Setup, values: np.ndarray) -> np.ndarray | None:
    """Return mass and place of a weight as large as the force along gravity; None if it lifts."""
    gravity = float(setup.gravity.norm())
    return np.array([values[0] / gravity, values[3]]) if gravity and values[0] > 0 else None


class PointForce(Effect):
    """Force [N] at an arc length, constant in space: along gravity, and along the two horizontal
    axes. The scan does not look for it: it is a tether without stiffness."""

    name = "point_force"
    locus = "point"
    scanned = False
    vector = ("force", "N")
    quantities = tuple(
        Quantity(name, "N", 0.03, by_weight=1.0) for name in ("down", "across_1", "across_2")
    )
    special_cases = (SpecialCase(PointMass, ("across_1", "across_2"), hanging_mass),)

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        share = at_point(setup.arc, values[3])
        force = values[:3] @ axes_of(setup)
        return setup._replace(load=setup.load + share[:, None] * force)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        note = "point_force: no target takes it; add it as a force on the nearest node"
        return Exported(beside, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        down, *across = (values[q.name] for q in self.quantities)
        return (
            f"a steady force acts on the rope at {values['arc_length']:.3f} m, {down:.3g} N "
            f"downwards and {float(np.hypot(*across)):.3g} N sideways"
        )


def axes_of(setup: Setup) -> Tensor:
    """Return (3, 3) the directions along gravity and along the two horizontal axes."""
    first, second = horizontal(setup.gravity)
    return torch.stack([torch.linalg.cross(first, second), first, second])
