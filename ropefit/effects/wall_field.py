"""A force of place along one direction: a wall that repels or attracts, wind in part of a room."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from ropefit.effects.base import Quantity, SpecialCase
from ropefit.effects.distributed_load import DistributedLoad
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.force_field import ForceInSpace
from ropefit.effects.law import Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.planar import (
    APART,
    FIRST_LOAD,
    LOADS,
    SMALLER,
    STARTS,
    STEEPEST,
    Falling,
    directions,
    largest,
    law_of,
    origin_of,
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

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        return with_profile(setup, values[:3], Falling(values[3], values[4]))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return directions along which most of the misfit points, with how fast it falls."""
        setup = misfit.setup
        length = float(setup.properties.length.sum())
        usual = self.quantities[0].size(setup)
        arm = misfit.places - origin_of(setup).numpy()
        tried = []
        for way in directions():
            d, along = arm @ way, misfit.moves @ way
            for decay in DECAYS:
                # Where the force is 1 where the rope is nearest to the wall.
                size = np.exp(-(decay / length) * (d - d.min()))
                score = float(along @ size / np.sqrt(size @ size))
                at = np.exp((decay / length) * d.min())
                tried.append((abs(score), way, np.sign(score) * at, decay / length))
        tried.sort(key=lambda t: -t[0])
        out: list[np.ndarray] = []
        for _, way, size, decay in tried:
            if all(abs(way @ v[:3] / np.linalg.norm(v[:3])) < np.cos(APART) for v in out):
                # A force against `way` grows along itself.
                load, decay = FIRST_LOAD * usual * size * way, np.sign(size) * decay
                out.append(np.array([*load, decay, 0.0]))
            if len(out) == STARTS:
                break
        return [[v, v * SMALLER] for v in out]

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
