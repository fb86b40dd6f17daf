"""A fixed round bar or edge that the rope touches in some frames, without friction."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.place import horizontal, middle_of
from ropefit.effects.support_plane import HARDNESS
from ropefit.rod.setup import Potential, Setup


class Obstacle(Effect):
    """A frictionless round bar of `radius` [m] through a point (x, y, z) [m] against the middle of
    the ends; its axis is horizontal, at `heading` [rad] from the first horizontal axis."""

    name = "obstacle"
    quantities = (
        *(Quantity(axis, "m", 0.1, by_length=1.0) for axis in "xyz"),
        Quantity("radius", "m", 0.02, 0.0, 0.2),
        Quantity("heading", "rad", 0.3, -3.2, 3.2),
    )
    linear = False

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        first, second = horizontal(setup.gravity)
        axis = torch.cos(values[4]) * first + torch.sin(values[4]) * second
        origin = middle_of(setup) + values[:3]
        radius, hardness = values[3], HARDNESS * setup.weight.detach()

        def energy(x: Tensor) -> Tensor:
            arm = x - origin
            across = arm - (arm * axis).sum(-1, keepdim=True) * axis
            distance = torch.sqrt((across * across).sum(-1) + 1e-16)
            return 0.5 * hardness * torch.clamp(radius - distance, min=0.0) ** 2

        # A bar touches few nodes: every one of them may be among these.
        share = torch.ones(setup.segments + 1, dtype=torch.float64)
        return setup._replace(potentials=(*setup.potentials, Potential(energy, share, hardness)))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"the rope touches a fixed obstacle of {values['radius'] * 1e3:.3g} mm radius, "
            f"{(values['x'] ** 2 + values['y'] ** 2 + values['z'] ** 2) ** 0.5:.3f} m from the "
            "middle of its ends"
        )
