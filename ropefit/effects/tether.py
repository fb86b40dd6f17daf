"""A thread from the rope to a fixed point in space."""

from __future__ import annotations

from torch import Tensor

from ropefit.effects.base import Effect, Quantity
from ropefit.effects.place import at_point, middle_of
from ropefit.rod.setup import Potential, Setup


class Tether(Effect):
    """A spring of `stiffness` k [N/m] from a place on the rope to an anchor.

    The other three values are k times the anchor's place against the middle of the ends [N], so
    that the force k (anchor - x) is linear in all four.
    """

    name = "tether"
    locus = "point"
    quantities = (
        Quantity("stiffness", "N/m", 0.1, lower=0.0, by_weight=1.0, by_length=-1.0),
        *(Quantity(f"pull_{axis}", "N", 0.03, by_weight=1.0) for axis in "xyz"),
    )

    def apply(self, setup: Setup, values: Tensor) -> Setup:
        share = at_point(setup.arc, values[4])
        middle = middle_of(setup)
        stiffness, pull = values[0], values[1:4]

        def energy(x: Tensor) -> Tensor:
            arm = x - middle
            return 0.5 * stiffness * (arm * arm).sum(-1) - (arm * pull).sum(-1)

        return setup._replace(potentials=(*setup.potentials, Potential(energy, share)))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"something pulls the rope at {values['arc_length']:.3f} m towards a fixed point, with "
            f"{values['stiffness']:.3g} N/m"
        )
