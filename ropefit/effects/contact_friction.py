"""A rope that sticks and drags on what it lies on."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.revisit import FEWEST
from ropefit.effects.support_plane import touching
from ropefit.rod.setup import Setup


class ContactFriction(Effect):
    """Coulomb's `coefficient` on every plane and bar that the rope touches already. What has only
    just touched down is not held yet.

    Between two frames a rope may be dragged by more than from one to the other. In the two
    recordings of another simulator that were answered the coefficient came out half as large again
    and 2.6 times as large; that it is known to a quarter is a judgement from the first.
    """

    name = "contact_friction"
    quantities = (Quantity("coefficient", "1", 0.3, 0.0, 2.0, inexact=0.25),)

    def applies(self, setup: Setup) -> bool:
        contacts = any(p.hardness is not None for p in setup.potentials)
        return contacts and len(setup.whole()[0].ends) >= FEWEST

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        # Every third of the nodes that touch for all.
        all_of_them = touching(setup.segments)
        third = torch.zeros_like(all_of_them)
        third[:: 3 * int(all_of_them.max())] = 3 * all_of_them.max()
        rough = tuple(
            p if p.hardness is None else p._replace(friction=values[0], rubbing=third)
            for p in setup.potentials
        )
        return setup._replace(potentials=rough)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the rope sticks and drags on what it lies on, with a coefficient of friction of "
            f"{values['coefficient']:.2g}"
        )
