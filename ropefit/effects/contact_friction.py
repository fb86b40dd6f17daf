"""Friction between the rope and what it lies on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from torch import Tensor

from ropefit import attachments as records
from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.contact import has_free_end, touching
from ropefit.effects.drawn import Drawn
from ropefit.effects.misfit import Misfit
from ropefit.effects.revisit import FEWEST
from ropefit.rod.setup import Setup

START = 0.3  # coefficient: a small one does not show what a large one does


class ContactFriction(Effect):
    """Coulomb's `coefficient` on every plane and bar that the rope touches already. A node that has
    only just touched down is not held yet.

    Between two frames a rope is dragged straight from one to the other, in increments where nodes
    touch down on the way (`models/increments.py`). In four recordings of another simulator that
    tell the coefficient, all else known, the shapes are then most alike at 0.7 to 1.0 times its
    value, as its rope swings and its friction creeps; without increments at 1.7 times and more. The
    relative error of a quarter is a judgement from these.
    """

    name = "contact_friction"
    in_motion = False
    quantities = (Quantity("coefficient", "1", 0.3, 0.0, 2.0, inexact=0.25),)
    path_dependent = True
    slow = True
    exact = False  # how a rope was dragged between two frames is not recorded

    def applies(self, setup: Setup) -> bool:
        contacts = any(p.hardness is not None for p in setup.potentials)
        return contacts and len(setup.whole()[0].ends) >= FEWEST

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        nodes = touching(setup.segments)  # all of them: few touch where a rope only dips down
        rough = tuple(
            p if p.hardness is None else p._replace(friction=values[0], rubbing=nodes)
            for p in setup.potentials
        )
        return setup._replace(potentials=rough)

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose a usual coefficient: friction holds the rope back from the first frame on."""
        if has_free_end(misfit) or self.name in misfit.terms:
            return []
        return [[np.array([START])]]

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        """Give the coefficient to all bodies that are exported already."""
        return Exported(tuple(rough(one, values["coefficient"]) for one in beside), settles=False)

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the rope sticks and slides on what it lies on, with a coefficient of friction of "
            f"{values['coefficient']:.2g}"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("loop")


def rough(record: Any, coefficient: float) -> Any:
    """Return a record with a coefficient of friction, where it is of a body that has one."""
    body = isinstance(record, records.Plane | records.Sphere | records.Cylinder)
    return replace(record, friction=coefficient) if body else record
