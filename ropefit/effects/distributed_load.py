"""A steady load on the whole rope besides its weight: wind, a magnetic or buoyant force."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.rod.setup import Setup


class DistributedLoad(Effect):
    """Force per length (x, y, z) [N/m], constant in space."""

    name = "distributed_load"
    vector = ("force_per_length", "N/m")
    quantities = tuple(
        Quantity(f"force_per_length_{axis}", "N/m", 0.03, by_weight=1.0, by_length=-1.0)
        for axis in "xyz"
    )

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        half = torch.nn.functional.pad(0.5 * setup.properties.length, (1, 1))
        share = half[1:] + half[:-1]
        return setup._replace(load=setup.load + share[:, None] * values)

    def sentence(self, values: dict[str, float]) -> str:
        x, y, z = (values[f"force_per_length_{axis}"] for axis in "xyz")
        return f"a steady load of ({x:.3g}, {y:.3g}, {z:.3g}) N/m acts on the whole rope"
