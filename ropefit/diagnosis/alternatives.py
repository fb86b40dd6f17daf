"""What else may stand in the place of one of two effects, and what the other one then is.

A load across the rope and an error of gravity may explain as much, but a weight beside the one is
not the weight beside the other. Where the data do not tell which it is, the intervals of the other
effect's sizes hold for both.
"""

from __future__ import annotations

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.last_fit import last_fit
from ropefit.diagnosis.reassessment import fitted_again, parts_of
from ropefit.inference.least_squares import Fit

ALTERNATIVES_TRIED = 1  # tried in the place of one effect

Alternative = tuple[Accepted, Fit]


def alternatives(current: Fit, accepted: list[Accepted]) -> list[Alternative]:
    """Return accepted effects, each with the fit of something equivalent in its place beside the
    others, that explains as much."""
    if len(accepted) < 2 or not current.forward.instantaneous:
        return []
    out = []
    for item in accepted:
        quick = [c for c in item.equivalent if not c.hypothesis.effect.slow]
        for other in quick[:ALTERNATIVES_TRIED]:
            theirs = next(part for part in parts_of(other.fit) if part[0] is other.term)
            parts = [
                theirs if part[0] is item.candidate.term else part for part in parts_of(current)
            ]
            fitted = fitted_again(current, parts, current.problem)
            if fitted is None or len(fitted.z) != len(current.z):
                continue
            if fitted.cost < current.cost + 2 * TIE_NATS * max(1.0, current.spread):
                out.append((item, last_fit(fitted)))
    return out
