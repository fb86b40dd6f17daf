"""What the sizes of an effect are where else it may act, if the data leave its place open.

Size and place trade off along a curve: a heavy weight near a clamp does what a light one does at
the tip. The covariance of a fit is that of its tangent. Where the interval of a place is long, the
sizes are fitted anew with the place held at its ends, and their intervals hold those, too. Of a
stretch that is its width; one that was fitted up to an end of the rope has no tangent there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import Candidate, columns_of
from ropefit.effects.base import PLACE_NAMES
from ropefit.effects.place import on_rope
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models.terms import Term

LEAST_HALF_WIDTH, MOST_HALF_WIDTH = 0.005, 0.5  # of the length: of the interval of a place
OPEN = 0.1  # of the length: half the interval of a place, from which it is open
SHARES = (1.0, 0.5)  # of the way to the end of the interval, until a fit there is as good
NO_WORSE = NORMAL_QUANTILE**2  # rise of χ², as large as what is missed makes it
NARROWER = 0.5  # of its width: how narrow such a stretch is tried
HELD = 1e-6  # of a place's scale: sd of one that is held
EVALUATIONS, TOLERANCE = 20, 1e-5


@dataclass(frozen=True)
class HeldPlace:
    """The fit with the place of a term held elsewhere, and the term that holds it."""

    term: Term
    held: Term
    fit: Fit

    def of(self, candidate: Candidate) -> Candidate:
        """Return a candidate of the last fit as it is here."""
        term = self.held if candidate.term is self.term else candidate.term
        return replace(candidate, term=term, fit=self.fit)


def half_interval(sd: float, length: float) -> float:
    """Return half the 95 % interval [m] of a place on a rope of a length [m]."""
    return min(max(NORMAL_QUANTILE * sd, LEAST_HALF_WIDTH * length), MOST_HALF_WIDTH * length)


def held_places(final: Fit, accepted: list[Accepted]) -> list[HeldPlace]:
    """Return the fits of a rope at rest with every open place held at the ends of its interval, or
    half the way there, that are not significantly worse than the last; not where the effect would
    have to be implausibly large, as a force next to a clamp."""
    if not final.forward.instantaneous:
        return []
    return [held for item in accepted for held in _of(final, item.candidate)]


def _of(final: Fit, candidate: Candidate) -> Iterator[HeldPlace]:
    effect = candidate.hypothesis.effect
    if effect.locus not in PLACE_NAMES or effect.slow:
        return
    now = replace(candidate, fit=final)
    for begin, end in _elsewhere(now, float(final.point.setup.properties.length.sum())):
        every = (_held(final, now.term, begin + share * (end - begin)) for share in SHARES)
        possible = (held for held in every if held and held.of(candidate).plausible())
        best = next(possible, None)
        if best is not None:
            yield best


def _elsewhere(now: Candidate, length: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return between which places (1,) or centres and widths (2,) [m] an effect may be."""
    names, term = PLACE_NAMES[now.hypothesis.effect.locus], now.term
    place, sd = now.values()[-len(names) :], float(now.sd()[-1])
    if len(names) == 2:
        low, high, first, last = on_rope(float(place[0]), float(place[1]), length)
        if first and last:
            return []
        if first or last:
            seen = np.array([(low + high) / 2, high - low])
            return [(seen, seen * (1.0, NARROWER))]
    half = half_interval(sd, length)
    if half < OPEN * length:
        return []
    ends = np.clip([place[-1] - half, place[-1] + half], term.lower[-1], term.upper[-1])
    return [(place, np.append(place[:-1], end)) for end in ends]


def _held(final: Fit, term: Term, place: np.ndarray) -> HeldPlace | None:
    """Return the fit with the last quantity of a term's place held; None where it is significantly
    worse."""
    columns = columns_of(final, term)[-len(place) :]
    held = replace(
        term, start=np.append(term.start[:-1], place[-1]),
        prior=np.append(term.prior[:-1], HELD * term.scale[-1]),
    )  # fmt: skip
    terms = [held if one is term else one for one in final.forward.terms]
    model = final.forward.with_terms(terms, final.point.solution)
    begin = final.point.u.copy()
    there = (place - term.start[-len(place) :]) / term.scale[-len(place) :]
    if len(place) == 1:  # of a stretch centre and width would run along each other
        begin += _along(final, columns[0], there[0] - begin[columns[0]])
    begin[columns] = [*there[:-1], 0.0]  # where it is held
    begin = np.clip(begin, *model.bounds())
    most = final.cost + NO_WORSE * max(1.0, final.spread, final.scale**2)
    fitted = attempted(
        model, final.problem, begin, EVALUATIONS, TOLERANCE, needed=most, thorough=True
    )
    if fitted is None or len(fitted.z) != len(final.z) or not fitted.point.converged.all():
        return None
    return HeldPlace(term, held, fitted) if fitted.cost < most else None


def _along(final: Fit, place: int, step: float) -> np.ndarray:
    """Return the step (P,) of all values for one of the place, along which χ² rises least."""
    covariance = final.covariance
    return covariance[:, place] / max(covariance[place, place], 1e-300) * step
