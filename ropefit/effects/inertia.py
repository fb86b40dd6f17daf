"""A rope whose own mass resists being accelerated: what a quasi-static model leaves out first."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.rod.setup import Setup


class Inertia(Effect):
    """`share` of the rope's inertia that acts: the force -share ρ a on every length of it, with the
    acceleration a as observed. It must come out as 1: a share far from it is another cause.

    Ten ropes filmed by another simulator came out 4 % off (rms) beyond their noise: accelerations
    are as observed, in steps and through gaps.
    """

    name = "inertia"
    quantities = (Quantity("share", "1", 1.0, 0.0, 3.0, inexact=0.04),)

    def applies(self, setup: Setup) -> bool:
        return setup.motion is not None

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        assert setup.motion is not None
        mass = node_share(setup, setup.properties.density)
        return setup._replace(
            load=setup.load - values[0] * mass[:, None] * setup.motion.acceleration
        )

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the rope's own mass resists being accelerated "
            f"({values['share']:.2f} of what its weight implies)"
        )


def node_share(setup: Setup, per_length: Tensor) -> Tensor:
    """(N+1,) of something per length (N,), half of each segment's at either node."""
    half = torch.nn.functional.pad(0.5 * per_length * setup.properties.length, (1, 1))
    return half[1:] + half[:-1]
