"""A force of place along one direction: a wall that repels or attracts, wind in part of a room."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Quantity, SpecialCase
from ropefit.effects.distributed_load import DistributedLoad
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.force_in_space import ForceInSpace
from ropefit.effects.law import Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.planar import (
    LOADS,
    STEEPEST,
    Falling,
    largest,
    law_of,
    planar_starts,
    with_profile,
)
from ropefit.rod.setup import Setup

DECAYS = (2.0, 6.0, 15.0)  # over the length: tried


class WallField(ForceInSpace):
    """A force per length along one direction, its size an exponential of the distance along it, and
    of the square of that; at `origin_of` it is the load."""

    quantities = (
        *LOADS,
        Quantity("decay", "1/m", 5.0, by_length=-1.0),
        Quantity("bend", "1/m^2", 5.0, by_length=-2.0),
    )
    special_cases = (SpecialCase(DistributedLoad, ("decay", "bend"), lambda _, values: values[:3]),)

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        length = float(setup.properties.length.sum())
        highest = [*largest(setup), STEEPEST / length, STEEPEST / length**2]
        return [-v for v in highest], highest

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return with_profile(setup, values[:3], Falling(values[3], values[4]))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return the two walls whose force explains most of the misfit, to first order."""
        length = float(misfit.setup.properties.length.sum())
        tried = np.array([[decay / length, 0.0] for decay in DECAYS])
        limits = np.array(self.bounds(misfit.setup)[1])
        return planar_starts(
            misfit, lambda _: tried, Falling, (3 / length, 3 / length**2), limits,
            np.array([-1.0, 1.0]),
        )  # fmt: skip

    def law(self, setup: Setup) -> Law:
        return law_of(self, setup)

    def sentence(self, values: dict[str, float]) -> str:
        x, y, z = (values[f"load_{axis}"] for axis in "xyz")
        way = "falls" if values["decay"] > 0 else "grows"
        return (
            f"a force of ({x:.2g}, {y:.2g}, {z:.2g}) N/m below the middle of the ends acts along "
            f"one direction in space, and {way} along it"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("load", vector=components(values, "load_"), label="a wall in space")
