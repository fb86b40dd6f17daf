"""The paper's six weights as rows of the table of parameters: meaning, start, bounds.

They are no properties of a rope and have no unit: they act on the moves of Algorithm 1. Beyond
their bounds the iterations diverge or do nothing.
"""

from __future__ import annotations

import numpy as np

from ropefit.models.parameters import Parameter, Range
from ropefit.models.terms import Apply
from ropefit.rod.setup import Setup

GRAVITY, CONSTRAINT = Range(0.04, 1e-5, 100.0), Range(1.0, 1e-3, 1.5)  # starts are the paper's
# Order of the six weights of Algorithm 1 in every parameter vector.
ETA = ("eta_x_G", "eta_x_D", "eta_x_S", "eta_q_S", "eta_q_B", "eta_SOR")


def eta_names(two_sided: bool) -> tuple[str, ...]:
    """Return the parameters: six, or seven when the two sides of the control point differ in
    gravity."""
    return ("eta_x_G_0", "eta_x_G_1", *ETA[1:]) if two_sided else ETA


def _setting(place: int) -> Apply:
    """Return what sets one of a setup's weights."""

    def apply(setup: Setup, v: np.ndarray) -> Setup:
        assert setup.weights is not None
        weights = setup.weights.copy()
        weights[..., place] = v[0]
        return setup._replace(weights=weights)

    return apply


def _weight(name: str, place: int, meaning: str, own: Range) -> Parameter:
    return Parameter(name, meaning, "1", "1", lambda _: own, _setting(place))


_ROWS = (
    ("eta_x_G", 0, "weight of gravity on positions", GRAVITY),
    ("eta_x_G_0", 0, "weight of gravity between end 0 and the control point", GRAVITY),
    ("eta_x_G_1", 1, "weight of gravity between the control point and end 1", GRAVITY),
    ("eta_x_D", -5, "weight of the distance constraint on positions", CONSTRAINT),
    ("eta_x_S", -4, "weight of the stretch-shear constraint on positions", CONSTRAINT),
    ("eta_q_S", -3, "weight of the stretch-shear constraint on frames", CONSTRAINT),
    ("eta_q_B", -2, "weight of the bend-twist constraint on frames", CONSTRAINT),
    ("eta_SOR", -1, "over-relaxation of all moves", CONSTRAINT),
)
WEIGHTS = {row[0]: _weight(*row) for row in _ROWS}
RANGES = {name: own for name, _, _, own in _ROWS}  # of every rope
