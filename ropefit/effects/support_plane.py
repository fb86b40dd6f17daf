"""A table or floor that the rope comes to lie on, without friction."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.place import horizontal, middle_of
from ropefit.rod.setup import Potential, Setup

HARDNESS = 200.0  # weights of the rope per metre of indentation: a hundredth of its weight: 50 µm


class SupportPlane(Effect):
    """A frictionless half space: `height` [m] against the middle of the ends, against gravity, and
    its slope [1] along the two horizontal axes."""

    name = "support_plane"
    quantities = (
        Quantity("height", "m", 0.1, by_length=1.0),
        Quantity("slope_1", "1", 0.02, -0.5, 0.5),
        Quantity("slope_2", "1", 0.02, -0.5, 0.5),
    )
    linear = False

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        up, normal = up_and_normal(setup, values[1], values[2])
        origin = middle_of(setup) + values[0] * up
        hardness = HARDNESS * setup.weight.detach()

        def energy(x: Tensor) -> Tensor:
            gap = ((x - origin) * normal).sum(-1)
            return 0.5 * hardness * torch.clamp(-gap, min=0.0) ** 2

        share = touching(setup.segments)
        return setup._replace(potentials=(*setup.potentials, Potential(energy, share, hardness)))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"in some frames the rope lies on a plane {abs(values['height']):.3f} m "
            f"{'below' if values['height'] < 0 else 'above'} the middle of its ends"
        )


def up_and_normal(setup: Setup, slope_1: Tensor, slope_2: Tensor) -> tuple[Tensor, Tensor]:
    """(3,), (3,) against gravity, and across a plane of these slopes along the horizontal axes."""
    first, second = horizontal(setup.gravity)
    up = -setup.gravity.detach() / setup.gravity.detach().norm()
    normal = up - slope_1 * first - slope_2 * second
    return up, normal / normal.norm()


def touching(segments: int) -> Tensor:
    """(N+1,) shares of the nodes in contact: some sixty nodes stand for the others, which bounds
    the cost of contact."""
    every = max(1, segments // 60)
    share = torch.zeros(segments + 1, dtype=torch.float64)
    share[::every] = float(every)
    return share
