"""Shapes that look like those of a solver that stopped on its way from the start."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.rod.setup import Setup
from ropefit.solvers.conditions import Conditions
from ropefit.solvers.equilibrium import solve


class UnderConverged(Effect):
    """`amount` of the way back from the equilibrium to the catenary that a solver starts from."""

    name = "under_converged"
    kind = "solver"
    quantities = (Quantity("amount", "1", 0.1, 0.0, 1.0),)

    def applies(self, setup: Setup) -> bool:
        return not bool(torch.isnan(setup.ends).any())

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        drift = setup.seen.drift + values[0] * _way_back(setup)
        return setup._replace(seen=setup.seen._replace(drift=drift))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the shapes are those of a solver that stopped "
            f"{100 * values['amount']:.0f} % short of its equilibrium"
        )


def _way_back(setup: Setup) -> Tensor:
    """(F, N+1, 3) [m] catenaries minus equilibria."""
    held = Conditions(setup.ends.detach(), setup.clamp.detach())
    rod = setup._replace(potentials=()).rod()
    start, found = solve(rod, held, limit=0, continuation=False), solve(rod, held)
    return torch.from_numpy(start.x - found.x)
