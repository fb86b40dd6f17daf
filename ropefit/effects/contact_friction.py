"""Friction between the rope and what it lies on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ropefit import attachments as records
from ropefit.effects.base import Effect, Exported, Quantity
from ropefit.effects.contact import has_free_end, touching
from ropefit.effects.drawn import Drawn
from ropefit.effects.misfit import Misfit
from ropefit.effects.revisit import FEWEST
from ropefit.rod import memory
from ropefit.rod.friction import push
from ropefit.rod.setup import Setup

START = 0.3  # coefficient
START_SHARES = (0.3, 0.7, 1.3, 2.3)  # times that: the misfit has many minima
LEAST_TOUCHED = 3  # frames in which a rope touches something, to tell friction from


class ContactFriction(Effect):
    """Coulomb's `coefficient` on every plane and bar that the rope touches already.

    Between two frames a rope is dragged straight from one to the other, in increments where nodes
    touch down on the way (`models/increments.py`). What it lay on before the recording is not
    known: frames until it first touches nothing are excluded (`begun_before`).
    """

    name = "contact_friction"
    in_motion = False
    quantities = (Quantity("coefficient", "1", 0.3, 0.0, 2.0, inexact=0.25),)
    path_dependent = True
    slow = True
    start_shares = START_SHARES
    exact = False  # how a rope was dragged between two frames is not recorded

    def applies(self, setup: Setup) -> bool:
        contacts = any(p.hardness is not None for p in setup.potentials)
        return contacts and len(setup.whole()[0].ends) >= FEWEST

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        nodes = touching(setup.segments)  # all of them: few touch where a rope only dips down
        rough = tuple(
            p if p.hardness is None else p._replace(friction=values[0], rubbing=nodes)
            for p in setup.potentials
        )
        return setup._replace(potentials=rough)

    def begun_before(self, setup: Setup, x: np.ndarray) -> np.ndarray:
        """Return the frames from a clip's first one until the rope touches nothing: how it came to
        lie there was not recorded. None where it hardly touches in the others, or these are few."""
        whole, shown = setup.whole()
        begins, at = memory.restarts(whole.clock[shown]), np.nan_to_num(x)
        contacts = [p for p in setup.potentials if p.hardness is not None]
        touches = [(push(p, at) != 0).any((-1, -2)) for p in contacts]
        lies = np.any(touches, axis=0)
        out, held = np.zeros(len(x), dtype=bool), False
        for t in range(len(x)):
            out[t] = held = bool(lies[t] and (held or begins[t]))
        enough = (~out).sum() >= FEWEST and (lies & ~out).sum() >= LEAST_TOUCHED
        return out if enough else np.zeros(len(x), dtype=bool)

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
