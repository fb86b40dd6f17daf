"""Errors of grips that move: how far a clamp is turned, and how far it yields."""

from __future__ import annotations

import numpy as np

from ropefit.effects.ends import turned_clamp
from ropefit.models.priors import DEGREE, nuisance, turn_clamp
from ropefit.models.terms import Apply, Term
from ropefit.rod.setup import Setup

TWIST = 1.0  # rad: one sigma of a twist that is not seen
LOOSE = 50.0  # rad/(N m) per weight and length: how far a grip may yield, see `_grip`


def grips(setup: Setup, degrees: float, twist: float | None = None) -> list[Term]:
    """Return how far each clamp is turned from what is recorded, the same in every frame,
    and how far it yields to bending; degrees: one sigma of the turn.

    twist [rad]: by how much the far clamp is turned about the rope, where no roll is seen.
    """
    p = setup.properties
    length, weight = float(p.length.sum()), float(setup.weight)
    terms = []
    for end in range(2):
        if not setup.clamped[end]:
            continue
        sd = degrees * DEGREE
        terms.append(
            nuisance(f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end), [sd] * 3)
        )
        usual = LOOSE / (weight * length)
        terms.append(
            Term(
                f"grip_{end}", ("give",), ("rad/(N m)",), _grip(end), np.full(1, 0.1 * usual),
                np.ones(1), np.full(1, 1e-4 * usual), np.full(1, 30 * usual), np.full(1, 2.0),
                log=True, nuisance=True,
            )
        )  # fmt: skip
    if twist is not None:
        one, wide = np.ones(1), np.full(1, 2 * np.pi)
        terms.append(
            Term("twist", ("angle",), ("rad",), _turn_far_clamp, twist * one, TWIST * one, -wide,
                 wide, TWIST * one, nuisance=True)
        )  # fmt: skip
    return terms


def _turn_far_clamp(setup: Setup, v: np.ndarray) -> Setup:
    return turned_clamp(setup, 1, np.concatenate([np.zeros(2), v]))


def _grip(end: int) -> Apply:
    at = np.zeros((2, 2))
    at[end, 0] = 1.0
    return lambda setup, v: setup._replace(clamp_compliance=setup.clamp_compliance + v[0] * at)
