"""A steady force on one place of the rope: a hand, a magnet far away."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity, SpecialCase
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import at_point, horizontal
from ropefit.effects.point_mass import PointMass
from ropefit.rod.setup import Setup


def hanging_mass(setup: Setup, values: np.ndarray) -> np.ndarray | None:
    """Return mass and place of a weight as large as the force along gravity; None if it lifts."""
    gravity = float(np.linalg.norm(setup.gravity))
    return np.array([values[0] / gravity, values[3]]) if gravity and values[0] > 0 else None


def weight_of(setup: Setup, values: np.ndarray) -> np.ndarray:
    """Return force and place of what a mass at a place weighs."""
    return np.array([values[0] * float(np.linalg.norm(setup.gravity)), 0.0, 0.0, values[1]])


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
    special_cases = (SpecialCase(PointMass, ("across_1", "across_2"), hanging_mass, weight_of),)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        share = at_point(setup.arc, values[3])
        force = values[:3] @ axes_of(setup)
        return setup._replace(load=setup.load + share[:, None] * force)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        note = "point_force: no target takes it; add it as a force on the nearest node"
        return Exported(beside, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        down, first, second = (values[q.name] for q in self.quantities)
        return (
            f"a steady force acts on the rope at {values['arc_length']:.3f} m, {down:.3g} N "
            f"downwards and {math.hypot(first, second):.3g} N sideways"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        force = np.array([values[q.name] for q in self.quantities])
        return Drawn("arrow", vector=force @ axes_along(gravity))


def axes_of(setup: Setup) -> np.ndarray:
    """Return (3, 3) the directions along gravity and along the two horizontal axes."""
    return axes_along(setup.gravity)


def axes_along(gravity: np.ndarray) -> np.ndarray:
    """Return (3, 3) the directions along gravity (3,) and along the two horizontal axes."""
    first, second = horizontal(gravity)
    return np.stack([np.cross(first, second), first, second])
