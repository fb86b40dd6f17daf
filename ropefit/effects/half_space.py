"""A force along one direction in one part of the room: wind behind an edge, a rope in water."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Quantity
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
    Step,
    directions,
    largest,
    law_of,
    origin_of,
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
        Quantity("sharpness", "1/m", 30.0, by_length=-1.0),
    )

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        length = float(setup.properties.length.sum())
        highest = [*largest(setup, MOST_LOAD), length, SHARPEST / length]
        return [-v for v in highest], highest

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        least = LEAST_SHARPNESS / float(setup.properties.length.sum())
        sharpness = torch.where(values[4].abs() < least, least, values[4])
        return with_profile(setup, values[:3], Step(values[3], sharpness))

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return directions along which most of the misfit points, behind an edge across them."""
        setup = misfit.setup
        length = float(setup.properties.length.sum())
        usual, sharpness = self.quantities[0].size(setup), FIRST_SHARPNESS / length
        arm = misfit.places - origin_of(setup).numpy()
        tried = []
        for way in directions():
            d, along = arm @ way, misfit.moves @ way
            for edge in np.quantile(d, EDGES):
                share = 1 / (1 + np.exp(np.clip(sharpness * (d - edge), -50, 50)))
                score = float(along @ share / np.sqrt(share @ share))
                tried.append((abs(score), np.sign(score) * way, np.sign(score), edge))
        tried.sort(key=lambda t: -t[0])
        out: list[np.ndarray] = []
        for _, way, sign, edge in tried:
            # A force against the direction that was tried is full beyond the edge along itself.
            if all(way @ v[:3] / np.linalg.norm(v[:3]) < np.cos(APART) for v in out):
                out.append(np.array([*FIRST_LOAD * usual * way, sign * edge, sign * sharpness]))
            if len(out) == STARTS:
                break
        # The same but for a load on all of the rope, which a fit without the field has taken up.
        out += [v * np.array([-1, -1, -1, -1, 1]) for v in out]
        return [[v, v * SMALLER] for v in out]

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
