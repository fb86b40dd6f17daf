"""Inertia of the rope: what a quasi-static model leaves out first."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.drawn import Drawn
from ropefit.effects.misfit import Misfit
from ropefit.rod.rod import at_nodes
from ropefit.rod.setup import Setup


class Inertia(Effect):
    """`share` of the rope's inertia that acts: the force -share ρ a on every length of it, with the
    acceleration a as observed. Its true value is 1: a share far from it has another cause.

    In ten ropes of another simulator the share was 4 % (rms) off beyond its noise: accelerations
    are observed in steps and through gaps.
    """

    name = "inertia"
    quantities = (Quantity("share", "1", 1.0, 0.0, 3.0, inexact=0.04),)
    counted = False  # every rope in motion has it
    in_motion = False
    exact = False  # no motion is explained down to the noise of its markers
    may_leave = 0.5

    def applies(self, setup: Setup) -> bool:
        return setup.motion is not None

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        assert setup.motion is not None
        mass = node_share(setup, setup.properties.density) + setup.mass
        return setup._replace(
            load=setup.load - values[0] * mass[:, None] * setup.motion.acceleration
        )

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Propose the whole inertia, if none acts yet.

        A model at rest fitted to a rope in motion becomes stiffer the faster it moves; a rigid one
        shows no force, and the scan, of small changes around it, does not see inertia.
        """
        return [] if self.name in misfit.terms else [[np.ones(1)]]

    def sentence(self, values: dict[str, float]) -> str:
        return (
            "the rope's own mass resists being accelerated "
            f"({values['share']:.2f} of what its weight implies)"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("swing")


def node_share(setup: Setup, per_length: np.ndarray) -> np.ndarray:
    """Return (N+1,) the nodes' shares of something per length (N,), half a segment's to each."""
    return at_nodes(0.5 * per_length * setup.properties.length)
