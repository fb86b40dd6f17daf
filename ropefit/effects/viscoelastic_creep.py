"""Viscoelastic creep: a rope that goes on bending under the same load."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.revisit import revisits
from ropefit.rod.memory import Branch
from ropefit.rod.setup import Setup


class ViscoelasticCreep(Effect):
    """A Maxwell branch: a rope stiffer by `share` when it is bent quickly, which relaxes with time
    constant `time` [s]. It is fully relaxed in the first frame."""

    name = "viscoelastic_creep"
    in_motion = False
    quantities = (
        Quantity("share", "1", 0.3, 0.0, 10.0),
        Quantity("time", "s", 0.15, 1e-3, 1e6, by_time=1.0),
    )
    linear = False
    path_dependent = True
    changes = False
    shaping = 1
    looks_like_noise = True
    tries = (0.2, 1.0, 4.0)

    def applies(self, setup: Setup) -> bool:
        return setup.time is not None and revisits(setup)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        never = np.array(np.inf)
        branch = Branch(values[0] * setup.properties.bend, never, values[1], fresh=False)
        return setup._replace(memory=(*setup.memory, branch))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"bent quickly the rope is {100 * values['share']:.2g} % stiffer, which fades within "
            f"{values['time']:.2g} s: it creeps"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("dashpot")
