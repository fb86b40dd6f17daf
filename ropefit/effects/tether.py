"""A thread from the rope to a fixed point in space."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit import attachments as records
from ropefit.effects.base import Effect, Exported, Quantity, SpecialCase
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.place import at_point, middle_of, nearest_node
from ropefit.effects.point_force import PointForce, axes_of
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Setup


def steady_pull(setup: Setup, values: np.ndarray) -> np.ndarray:
    """Return force and place of a tether that pulls the same wherever the rope is."""
    return np.array([*(axes_of(setup) @ values[1:4]), values[4]])


def without_stiffness(setup: Setup, values: np.ndarray) -> np.ndarray:
    """Return the tether that pulls with a force at a place wherever the rope is."""
    return np.array([0.0, *(values[:3] @ axes_of(setup)), values[3]])


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

    special_cases = (SpecialCase(PointForce, ("stiffness",), steady_pull, without_stiffness),)

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        share = at_point(setup.arc, values[4])
        middle = middle_of(setup)
        stiffness, pull = values[0], values[1:4]
        if setup.damping is not None:  # in motion: part of every step
            springs = np.zeros_like(share) if setup.springs is None else setup.springs
            steady = share[:, None] * (pull + stiffness * middle)
            return setup._replace(springs=springs + share * stiffness, load=setup.load + steady)

        def energy(x: np.ndarray) -> np.ndarray:
            arm = x - middle
            return 0.5 * stiffness * (arm * arm).sum(-1) - arm @ pull

        def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            rows = np.broadcast_to(stiffness * np.eye(3), (*x.shape, 3))
            return stiffness * (x - middle) - pull, rows

        spring = Potential(energy, share, derivatives=derivatives, quadratic=True)
        return setup._replace(potentials=(*setup.potentials, spring))

    def unit_loads(self, setup: Setup, x: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the force k (anchor - x) on the place, per unit of k and of k anchor."""
        share = at_point(setup.arc, place[0])
        arm = np.einsum("k,fka->fa", share, x) - middle_of(setup)
        load = np.zeros((len(x), 4, x.shape[1], 3))
        load[:, 0] = -share[None, :, None] * arm[:, None, :]
        for a in range(3):
            load[:, 1 + a, :, a] = share
        return load

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        if values["stiffness"] <= 0:
            return Exported(beside, note="tether could not be turned into the simulator's terms")
        pull = np.array([values[f"pull_{axis}"] for axis in "xyz"])
        anchor = middle_of(setup) + pull / values["stiffness"]
        node = nearest_node(setup, values["arc_length"], nodes)
        spring = records.Tether(node, records.vector(anchor), values["stiffness"], 0.0)
        return Exported((*beside, spring))

    def sentence(self, values: dict[str, float]) -> str:
        return (
            f"something pulls the rope at {values['arc_length']:.3f} m towards a fixed point, with "
            f"{values['stiffness']:.3g} N/m"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        pull = components(values, "pull_")
        if values["stiffness"] <= 0:
            return Drawn("arrow", vector=pull)
        return Drawn("tether", point=pull / values["stiffness"])
