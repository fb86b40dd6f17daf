"""A stretch of rope that is heavier or lighter than the rest."""

from __future__ import annotations

import math

import numpy as np

from ropefit.effects.base import Effect, Quantity, SpecialCase
from ropefit.effects.drawn import Drawn
from ropefit.effects.place import on_rope, over_interval
from ropefit.effects.point_mass import PointMass
from ropefit.rod.setup import Setup


def gathered(setup: Setup, values: np.ndarray) -> np.ndarray | None:
    """Return mass and place of a heavier section of no width; None for a lighter one."""
    return values[:2].copy() if values[0] > 0 else None


class MassSection(Effect):
    """`mass` [kg] more (or less), spread evenly over an interval."""

    name = "mass_section"
    of_rope = True
    locus = "interval"
    quantities = (Quantity("mass", "kg", 0.01, by_weight=1.0),)

    special_cases = (SpecialCase(PointMass, ("width",), gathered),)

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        """Return the bounds: nothing is lighter by more than all that it weighs."""
        return [-float((setup.properties.density * setup.properties.length).sum())], [math.inf]

    def more_usual(self, setup: Setup, values: np.ndarray) -> np.ndarray | None:
        """Return the rest of the rope as the heavier section, where a lighter one reaches an end:
        shapes show ratios to the weight only."""
        p = setup.properties
        mass, centre, width = values
        length, weight = float(p.length.sum()), float((p.density * p.length).sum())
        low, high, first, last = on_rope(float(centre), float(width), length)
        if mass >= 0 or first == last:
            return None
        begin, end = (high, length) if first else (0.0, low)
        left = weight / length + mass / (high - low)  # density of the lighter section [kg/m]
        if left <= 0:
            return None
        heavier = -mass / (high - low) * (end - begin) * (weight / length) / left
        return np.array([heavier, (begin + end) / 2, end - begin])

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p = setup.properties
        inside = over_interval(setup.arc, values[1], values[2])
        extra = values[0] * inside / (inside * p.length).sum()
        return setup._replace(properties=p._replace(density=p.density + extra))

    def sentence(self, values: dict[str, float]) -> str:
        more = "heavier" if values["mass"] > 0 else "lighter"
        return (
            f"{values['width']:.2f} m of rope about {values['centre']:.3f} m are "
            f"{abs(values['mass']) * 1e3:.3g} g {more} than the rest"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("load", vector=gravity * values["mass"])
