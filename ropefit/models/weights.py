"""The paper's six weights as rows of the table of parameters: meaning, start, bounds.

They are no properties of a rope and have no unit: they act on the moves of Algorithm 1, not on a
setup. Beyond their bounds the iterations diverge or do nothing.
"""

from __future__ import annotations

from typing import NamedTuple

from ropefit.models.parameters import Range

GRAVITY, CONSTRAINT = Range(0.04, 1e-5, 100.0), Range(1.0, 1e-3, 1.5)  # starts are the paper's


class Weight(NamedTuple):
    """One weight: what it multiplies, where its search starts, its bounds."""

    meaning: str
    range: Range


WEIGHTS = {
    "eta_x_G": Weight("weight of gravity on positions", GRAVITY),
    "eta_x_G_0": Weight("weight of gravity between end 0 and the control point", GRAVITY),
    "eta_x_G_1": Weight("weight of gravity between the control point and end 1", GRAVITY),
    "eta_x_D": Weight("weight of the distance constraint on positions", CONSTRAINT),
    "eta_x_S": Weight("weight of the stretch-shear constraint on positions", CONSTRAINT),
    "eta_q_S": Weight("weight of the stretch-shear constraint on frames", CONSTRAINT),
    "eta_q_B": Weight("weight of the bend-twist constraint on frames", CONSTRAINT),
    "eta_SOR": Weight("over-relaxation of all moves", CONSTRAINT),
}
