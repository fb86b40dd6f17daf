"""A force along one direction in one part of the room: wind behind an edge, a rope in water."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.force_in_space import ForceInSpace
from ropefit.effects.law import Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.planar import (
    LOADS,
    Step,
    largest,
    law_of,
    planar_starts,
    with_profile,
)
from ropefit.rod.setup import Setup

FIRST_SHARPNESS, LEAST_SHARPNESS, SHARPEST = 30.0, 1e-3, 100.0  # over the length
MOST_LOAD = 20.0  # usual loads, twice the weight: what holds the rope out altogether is touched
EDGES = np.linspace(0.1, 0.9, 9)  # tried: quantiles of the distances of the data


class HalfSpace(ForceInSpace):
    """A force per length on what is behind a plane across it (or beyond, where the sharpness is
    negative); over about 4 / sharpness [m] it rises."""

    quantities = (
        *LOADS,
        Quantity("edge", "m", 0.2, by_length=1.0),
        Quantity("sharpness", "1/m", 30.0, by_length=-1.0, open_ended=True),
    )

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        length = float(setup.properties.length.sum())
        highest = [*largest(setup, MOST_LOAD), length, SHARPEST / length]
        return [-v for v in highest], highest

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        least = LEAST_SHARPNESS / float(setup.properties.length.sum())
        sharpness = np.where(abs(values[4]) < least, least, values[4])
        return with_profile(setup, values[:3], Step(values[3], sharpness))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return the two parts of the room in which a force explains most of the misfit, to first
        order."""
        length = float(misfit.setup.properties.length.sum())
        sharpness = FIRST_SHARPNESS / length

        def tried(d: np.ndarray) -> np.ndarray:
            return np.stack([np.quantile(d, EDGES), np.full(len(EDGES), sharpness)], axis=1)

        limits = np.array(self.bounds(misfit.setup)[1])
        return planar_starts(
            misfit, tried, Step, (0.1 * length, 0.0), limits, np.array([-1.0, -1.0])
        )

    def law(self, setup: Setup) -> Law:
        return law_of(self, setup)

    def sentence(self, values: dict[str, float]) -> str:
        x, y, z = (values[f"load_{axis}"] for axis in "xyz")
        side = "behind" if values["sharpness"] > 0 else "beyond"
        return (
            f"a force of ({x:.2g}, {y:.2g}, {z:.2g}) N/m acts on what is {side} a plane across it"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("load", vector=components(values, "load_"), label="a part of the room")
