"""A steady load on the whole rope in addition to its weight: wind, a magnetic force."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.misfit import Misfit
from ropefit.rod.rod import at_nodes
from ropefit.rod.setup import Setup


class DistributedLoad(Effect):
    """Force per length (x, y, z) [N/m], constant in space."""

    name = "distributed_load"
    vector = ("force_per_length", "N/m")
    quantities = tuple(
        Quantity(f"force_per_length_{axis}", "N/m", 0.03, by_weight=1.0, by_length=-1.0)
        for axis in "xyz"
    )

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        share = at_nodes(0.5 * setup.properties.length)
        return setup._replace(load=setup.load + share[:, None] * values)

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose the load that pulls as another gravity does."""
        setup = misfit.stated
        moved = leader.apply(setup, values).gravity - setup.gravity
        if self.name in misfit.terms or not moved.any():
            return []
        p = setup.properties
        return [[moved * float((p.density * p.length).sum() / p.length.sum())]]

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        note = "distributed_load: no target takes it; add it as a force on every node"
        return Exported(beside, note=note)

    def sentence(self, values: dict[str, float]) -> str:
        x, y, z = (values[f"force_per_length_{axis}"] for axis in "xyz")
        return f"a steady load of ({x:.3g}, {y:.3g}, {z:.3g}) N/m acts on the whole rope"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("load", vector=components(values, "force_per_length_"))
