"""Contact fitted anew from shifted values, where something is still missing beside it.

Which nodes touch changes along with what they touch: such a fit has many local minima, and what one
of them leaves looks like a further contact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.beginning import JUMPED
from ropefit.diagnosis.candidate import comparable
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.terms import Term

SHIFTS = (-3.0, 3.0)  # standard errors
EXPLORING = 8  # evaluations of each start
EVALUATIONS = 25  # of the best one


def contact_anew(
    current: Fit, accepted: list[Accepted], least_gain: float
) -> tuple[Fit, list[Accepted]] | None:
    """Return a fit of the same model in a better minimum of its contact, by at least a gain [nats],
    with the accepted effects; None if it touches nothing, or there is none."""
    touching = [one for one in accepted if one.candidate.hypothesis.effect.slow]
    if not touching or not current.forward.instantaneous or current.point.setup.remembers:
        return None
    best = _better_nearby(current, [one.candidate.term for one in touching], least_gain)
    if best is None:
        return None
    gain = 0.5 * (current.cost - best.cost) / len(touching)
    return best, [
        _with_gain(one, gain) if any(one is t for t in touching) else one for one in accepted
    ]


def _with_gain(one: Accepted, gain: float) -> Accepted:
    """Return an accepted effect with more evidence, and what explains as much all the same."""
    evidence = one.evidence + gain
    same = [c for c in one.equivalent if c.evidence > evidence - TIE_NATS]
    return replace(one, evidence=evidence, equivalent=same)


def _better_nearby(current: Fit, terms: list[Term], least_gain: float) -> Fit | None:
    """Return the fit continued, or the best of shifted starts, whichever comes first to gain."""
    enough = current.cost - 2 * least_gain
    again = _continued(current, current)
    if again is not None and again.cost < enough:
        return again
    forward = current.forward.starting_from(current.point.solution)
    tried = (
        attempted(
            forward, current.problem, start, EXPLORING, 1e-4, needed=enough, matched=False,
            highest=JUMPED * current.cost,
        )
        for start in _shifted(current, terms)
    )  # fmt: skip
    found = [f for f in tried if f is not None and comparable(f, current)]
    best = min(found, key=lambda f: f.cost, default=None)
    again = best and _continued(best, current)
    return again if again is not None and again.cost < enough else None


def _continued(fitted: Fit, current: Fit) -> Fit | None:
    """Return a fit after more evaluations; None if it cannot be compared with the current one."""
    forward = fitted.forward.starting_from(fitted.point.solution)
    again = attempted(forward, current.problem, fitted.point.u, EVALUATIONS, 1e-5)
    return again if again is not None and comparable(again, current) else None


def _shifted(current: Fit, terms: list[Term]) -> Iterator[np.ndarray]:
    """Yield search variables (P,) with one value of a contact some standard errors off, the others
    as fits best beside it, to first order."""
    (low, high), covariance, first = current.forward.bounds(), current.by_noise, 0
    for term in current.forward.terms:
        touches = any(term is t for t in terms)
        for k in range(first, first + term.size) if touches else ():
            sd = float(np.sqrt(max(covariance[k, k], np.finfo(float).tiny)))
            for shift in SHIFTS:
                yield np.clip(current.point.u + shift * covariance[:, k] / sd, low, high)
        first += term.size
