"""What else may stand in the place of one of two effects, or nothing, and what the other then is.

A load across the rope and an error of gravity may explain as much, but a weight beside the one is
not the weight beside the other. Where the data do not tell which it is, the intervals of the other
effect's sizes and place hold for both. So they do without a second effect of little evidence on a
rope that is known from another recording only up to what its model misses.
"""

from __future__ import annotations

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import compared
from ropefit.diagnosis.equivalence import BY_MISFIT, TIE_NATS
from ropefit.diagnosis.last_fit import last_fit
from ropefit.diagnosis.reassessment import fitted_again, last_fit_without, parts_of
from ropefit.inference.least_squares import Fit

ALTERNATIVES_TRIED = 1  # tried in the place of one effect

Alternative = tuple[Accepted, Fit]


def alternatives(current: Fit, accepted: list[Accepted], threshold: float) -> list[Alternative]:
    """Return accepted effects, each with the fit of something equivalent in its place beside the
    others, that explains as much; and with that of nothing in its place, where its evidence is as
    good as `threshold` [nats], that from which effects are accepted."""
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
        without = _without(current, accepted, item, threshold) if current.known_elsewhere else None
        if without is not None:
            out.append((item, without))
    return out


def _without(
    current: Fit, accepted: list[Accepted], item: Accepted, threshold: float
) -> Fit | None:
    """Return the fit without an effect; None where its evidence is beyond doubt, or another effect
    needs it."""
    if item.candidate.hypothesis.effect.slow:
        return None
    without = last_fit_without(current, item, accepted)
    if without is None:
        return None
    now = compared(item.candidate.hypothesis, item.candidate.term, without, current)
    return without if now.evidence < BY_MISFIT * threshold else None
