"""A rope that is not straight when nothing acts on it: coiled storage, a set."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity, SpecialCase
from ropefit.effects.drawn import Drawn
from ropefit.effects.kink import FreeKink, Kink, log_width
from ropefit.effects.place import over_interval
from ropefit.rod.setup import Setup, twist_held

WHOLE = 0.9  # of the length: what is wider has no edges that could move


def sharp_bend(setup: Setup, values: np.ndarray) -> np.ndarray:
    """Return angles and place of a sharp bend that turns the rope by as much."""
    *curvature, centre, width = values
    return np.array([*(width * c for c in curvature), log_width(setup), centre])


class IntrinsicCurvature(Effect):
    """Rest curvature [1/m] over an interval, about the rope's own two directions across it.

    Where no end holds the rope against spinning, it turns until the curvature lies as it costs
    least: then only its size acts, see `FreeCurvature`.
    """

    name = "intrinsic_curvature"
    of_rope = True
    locus = "interval"
    vector = ("curvature", "1/m")
    quantities = (
        Quantity("curvature_1", "1/m", 0.3, by_length=-1.0),
        Quantity("curvature_2", "1/m", 0.3, by_length=-1.0),
    )

    special_cases = (SpecialCase(Kink, ("width",), sharp_bend),)

    def applies(self, setup: Setup) -> bool:
        return twist_held(setup)

    def scan_places(self, setup: Setup) -> np.ndarray:
        """Return the usual intervals, and the whole rope: coiled storage bends all of it."""
        length = float(setup.properties.length.sum())
        return np.vstack([super().scan_places(setup), [0.5 * length, WHOLE * length]])

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        p = setup.properties
        inside = over_interval(setup.arc, values[2], values[3])
        turn = np.append(values[:2], 0.0)
        return setup._replace(properties=p._replace(curvature=p.curvature + inside[:, None] * turn))

    def sentence(self, values: dict[str, float]) -> str:
        size = (values.get("curvature_1", 0) ** 2 + values.get("curvature_2", 0) ** 2) ** 0.5
        return (
            f"the unloaded rope is curved with radius {1 / max(size, 1e-9):.2g} m over "
            f"{values['width']:.2f} m about {values['centre']:.3f} m"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        size = np.hypot(values.get("curvature_1", 0.0), values.get("curvature_2", 0.0))
        radius = 1 / max(float(size), 1e-9)
        return Drawn("arc", size=radius, label=f"radius {radius:.2g} m")


class FreeCurvature(IntrinsicCurvature):
    """The same for a rope that is free to spin: only the size of the curvature acts."""

    vector = None
    quantities = (Quantity("curvature", "1/m", 0.3, lower=0.0, by_length=-1.0),)
    special_cases = (SpecialCase(FreeKink, ("width",), sharp_bend),)
    linear = False
    turns_rope = True

    def applies(self, setup: Setup) -> bool:
        return not twist_held(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return super().apply(setup, np.insert(values, 1, 0.0))

    def sentence(self, values: dict[str, float]) -> str:
        return super().sentence({"curvature_1": values["curvature"], **values})

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return super().drawn({"curvature_1": values["curvature"], **values}, gravity)
