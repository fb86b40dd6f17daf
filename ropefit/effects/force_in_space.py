"""What forces of place in space have in common, whatever function of place they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.effects.base import Effect, Exported
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Setup

LUMPS = 16  # parts of the rope: forces change little over one


class Field:
    """An energy per length that is a function of place in space."""

    def force_at(self, x: np.ndarray) -> np.ndarray:
        """Return the force per length (..., 3) [N/m] at x (..., 3) [m]."""
        raise NotImplementedError

    def derivatives(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the energy's slope (..., 3) and curvature (..., 3, 3) in closed form."""
        raise NotImplementedError

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Return the energy per length (...) [J/m] at x (..., 3) [m]."""
        raise NotImplementedError


class ForceInSpace(Effect):
    """A force per length that is a function of place in space, whatever function that is."""

    name = "force_field"
    in_motion = False
    scanned = False
    late = True
    linear = False
    stands_for_others = True
    held_out = "stretches"  # the frames that come near it tell most of it

    def applies(self, setup: Setup) -> bool:
        return not has_field(setup)

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        return Exported(beside, note="force_field: forces of place in space are not expressed")


def with_field(setup: Setup, field: Field) -> Setup:
    """Return the setup with a force of place."""
    energy = Potential(field, lumped(setup.arc), derivatives=field.derivatives)
    return setup._replace(potentials=(*setup.potentials, energy))


def has_field(setup: Setup) -> bool:
    """Say whether a force of place acts in a setup, of whichever kind: two would compensate."""
    return any(isinstance(p.energy, Field) for p in setup.potentials)


def lumped(arc: np.ndarray) -> np.ndarray:
    """Return (N+1,) [m] how much of the rope, with nodes at arc (N+1,) [m], the field acts on at
    each node: at LUMPS + 1 of them, by the trapezoidal rule. Every further one would be three
    supports more in every factorisation."""
    nodes = np.linspace(0, len(arc) - 1, min(LUMPS, len(arc) - 1) + 1).round().astype(int)
    half, share = 0.5 * np.diff(arc[nodes]), np.zeros_like(arc)
    share[nodes[1:]] += half
    share[nodes[:-1]] += half
    return share
