"""A candidate: a hypothesis fitted in full on top of a model, with its log evidence over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.beginning import HOPELESS, beginning, touches
from ropefit.diagnosis.held_out import block_losses, by_stretches, firm_rows
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models.terms import SIZE_PRIOR_SD, Term

PLACE_PRIOR_SD = 0.29  # of the length: sd of a uniform place
EVALUATIONS, TOLERANCE = 25, 1e-5
SLOW_EVALUATIONS = 6  # of a slow fit, in which it must gain something
MISSED_ALIKE = 0.5  # of what a model leaves beyond noise: a larger one with more misses the same
SLOW_ROUNDS = 4  # so often it is continued
SLOW_COST, SLOW_SHARE = 4.0, 0.05  # least gain of a round: cost, and share of all gained so far
UNSEEN = 1e-6  # whitened change of all data by a step of one: less is rounding
NO_VARIANCE = 1e-10  # of the largest: less is rounding


@dataclass
class Candidate:
    """A hypothesis fitted in full: log evidence [nats] over the smaller model, and its gain in
    every held-out block [nats]."""

    hypothesis: Hypothesis
    term: Term
    fit: Fit
    evidence: float
    gains: np.ndarray

    def values(self) -> np.ndarray:
        """Return (k + p,) values in SI, directions of unit length."""
        return self._raw() / self._length()

    def sd(self) -> np.ndarray:
        """Return (k + p,) standard errors in SI."""
        sd = np.sqrt(np.maximum(np.diag(self.covariance()), 0.0))
        return sd * self.term.slope(self._mine(self.fit.point.u)) / self._length()

    def covariance_of_values(self) -> np.ndarray:
        """Return (k + p, k + p) the covariance of its values in SI, to first order."""
        slope = self.term.slope(self._mine(self.fit.point.u)) / self._length()
        return slope[:, None] * self.covariance() * slope

    def covariance(self, by_noise: bool = False) -> np.ndarray:
        """Return (k + p, k + p) the covariance of its values in search coordinates; by the noise:
        as if nothing misled them."""
        mine = self._mine(np.arange(len(self.fit.point.u)))
        whole = self.fit.by_noise if by_noise else self.fit.covariance
        out = whole[np.ix_(mine, mine)]
        along = np.where(self.term.in_direction, self._raw() / self.term.scale, 0.0)
        if along.any():  # in motion variances are widened component by component
            across = np.eye(len(along)) - np.outer(along, along) / (along @ along)
            out = across @ out @ across
        return out

    def interval(self, width: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (k + p,), (k + p,) values in SI `width` standard errors to either side."""
        covariance = self.covariance()
        mine = self._mine(np.arange(self.fit.jacobian.shape[1]))
        unseen = np.linalg.norm(self.fit.jacobian[:, mine], axis=0) < UNSEEN
        limited = np.isfinite(self.term.lower) & np.isfinite(self.term.upper)
        covariance[np.diag(unseen & limited)] = np.inf  # as wide as its bounds
        return self.term.interval(self._mine(self.fit.point.u), covariance, width)

    def usual_sizes(self) -> np.ndarray:
        """Return (k,) its sizes as multiples of usual ones, at most 1 of one that saturates."""
        k, zero = self.hypothesis.size, self.term.search(np.zeros(self.term.size))
        return (self._mine(self.fit.point.u) - zero)[:k]

    def significance(self) -> float:
        """Return how many standard errors its sizes are from zero, together.

        Where few samples are independent a standard error is longer, as Student's t is.
        """
        off, k, found = self.usual_sizes(), self.hypothesis.size, self.fit
        # What is missed here may have a further cause; what was missed elsewhere has none here.
        known = found.problem.noise.misfit
        covariance = self.covariance(by_noise=not known)[:k, :k]
        # What nothing determines has no variance in it but for rounding, and is not counted.
        information = np.linalg.pinv(covariance, rcond=NO_VARIANCE, hermitian=True)
        apart = np.sqrt(max(off @ information @ off, 0.0))
        return float(apart * NORMAL_QUANTILE / (found.quantile if known else found.student))

    def plausible(self) -> bool:
        """Return whether its sizes are none that its effect calls implausible."""
        effect = self.hypothesis.effect
        return not effect.linear or bool(np.abs(self.usual_sizes()).max() <= effect.implausible)

    def magnitude(self) -> tuple[float, float]:
        """Return the length of a vector of sizes, and its standard error, in SI."""
        k = self.hypothesis.size
        values, slope = self.values()[:k], self.term.slope(self._mine(self.fit.point.u))[:k]
        size = float(np.linalg.norm(values))
        along = slope * values / max(size, 1e-300)
        return size, float(np.sqrt(max(along @ self.covariance()[:k, :k] @ along, 0.0)))

    def wants_beyond_bounds(self) -> bool:
        """Return whether the data want one of its values significantly beyond its bounds, to first
        order: what is possible does not explain them to the full."""
        found, mine = self.fit, self._mine(np.arange(len(self.fit.point.u)))
        held = found.prior.information
        information = found.jacobian.T @ found.jacobian / found.spread + held
        pull = found.jacobian.T @ found.z / found.spread - held @ found.point.u
        inverse = np.linalg.pinv(information, rcond=1e-14, hermitian=True)
        wanted, sd = (inverse @ pull)[mine], np.sqrt(np.maximum(np.diag(inverse)[mine], 0.0))
        u = self._mine(found.point.u)
        low, high = self.term.search(self.term.lower), self.term.search(self.term.upper)
        return bool(np.any(np.maximum(u + wanted - high, low - u - wanted) > NORMAL_QUANTILE * sd))

    def _raw(self) -> np.ndarray:
        """Return (k + p,) values in SI as they were fitted."""
        return self.term.value(self._mine(self.fit.point.u))

    def _length(self) -> np.ndarray:
        """Return (k + p,) the length of the direction for its components, else 1."""
        components = self.term.in_direction
        return np.where(components, np.linalg.norm(self._raw()[components]), 1.0)

    def _mine(self, u: np.ndarray) -> np.ndarray:
        """Return its part of the fit's values (P,), whatever was added to the model after it."""
        forward = self.fit.forward
        parts = zip(forward.terms, forward.split(u), strict=True)
        return next(part for term, part in parts if term is self.term)


def fit_candidate(
    smaller: Fit, hypothesis: Hypothesis, start: np.ndarray, lowest: float = np.inf,
    needed: float = np.inf, evaluations: int = EVALUATIONS, least_gain: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Candidate | None:  # fmt: skip
    """Fit a hypothesis on top of a model, from `start` (k + p,) in SI. None if it cannot settle, or
    gains less than `least_gain` [nats] to first order.

    lowest: cost of the best other candidate; a slow fit that cannot reach it is not continued.
    needed: cost that makes a difference; a fit without prospect of it is stopped. tolerance:
    relative decrease of the cost at which a fit ends.
    """
    begun = beginning(smaller, hypothesis, start, least_gain)
    if begun is None:
        return None
    slow = hypothesis.effect.slow
    if slow and not (touches(begun) and begun.promising()):
        return None
    most = SLOW_EVALUATIONS if slow else evaluations
    needed = np.inf if slow else needed  # contact has no linear steps
    fitted = attempted(
        begun.forward, smaller.problem, begun.values, most, tolerance, needed, matched=not slow,
        highest=HOPELESS * smaller.cost if slow else np.inf,
    )  # fmt: skip
    if slow and fitted is not None and fitted.cost < smaller.cost:
        fitted = continued(smaller.cost, fitted, lowest)
    return compared_if_comparable(hypothesis, begun.terms[0], smaller, fitted)


def comparable(one: Fit, other: Fit) -> bool:
    """Return whether all frames of a fit settle, and it is of as many data as another: of fewer if
    a frame did not settle where it began."""
    return bool(one.point.converged.all()) and len(one.z) == len(other.z)


def compared_if_comparable(
    hypothesis: Hypothesis, term: Term, smaller: Fit, fitted: Fit | None
) -> Candidate | None:
    """Return the candidate, if there is a fit and its frames settle as those of the smaller model
    do."""
    if fitted is None or not np.isfinite(fitted.cost) or not comparable(fitted, smaller):
        return None
    return compared(hypothesis, term, smaller, fitted)


def recompared(candidates: list[Candidate], smaller: Fit) -> list[Candidate]:
    """Return candidates, as fitted, over another fit of the same smaller model."""
    again = (compared_if_comparable(c.hypothesis, c.term, smaller, c.fit) for c in candidates)
    return [candidate for candidate in again if candidate is not None]


def continued(before: float, fitted: Fit, lowest: float, as_matched: bool = True) -> Fit:
    """Continue a slow fit as long as it gains: contact comes and goes, and gains soon
    shrink. One that even at its present pace could not reach the cost `lowest` stays as it is.
    as_matched: also until the data stay matched to the rope as they are."""
    for left in range(SLOW_ROUNDS, 0, -1):
        ended = fitted.converged and fitted.as_matched
        if ended or fitted.cost - left * SLOW_EVALUATIONS * pace(fitted) > lowest:
            break
        again = attempted(
            fitted.forward, fitted.problem, fitted.point.u, SLOW_EVALUATIONS, tolerance=1e-4,
            matched=False,
        )  # fmt: skip
        if again is None or len(again.z) != len(fitted.z):
            break
        least = max(SLOW_COST, SLOW_SHARE * (before - fitted.cost))
        gained, fitted = fitted.cost - again.cost, again  # as matched anew
        if gained < least and (fitted.as_matched or not as_matched):
            break
    return fitted


def pace(fitted: Fit) -> float:
    """Return how much each evaluation in the second half of a fit has lowered its cost."""
    half = len(fitted.trace) // 2
    return (min(fitted.trace[: half + 1]) - fitted.cost) / max(len(fitted.trace) - 1 - half, 1)


def compared(hypothesis: Hypothesis, term: Term, smaller: Fit, fitted: Fit) -> Candidate:
    """Compare a fitted hypothesis with the smaller model, which has all other terms.

    The log evidence is Laplace's approximation, with broad priors; what even the larger model
    misses scales it down.
    """
    spread = max(1.0, fitted.spread)
    evidence = 0.5 * (smaller.cost - fitted.cost) / spread - occam_factor(fitted, term)
    along = by_stretches(fitted)
    firm = firm_rows(smaller, fitted)
    gains = block_losses(smaller, along, firm) - block_losses(fitted, along, firm)
    return Candidate(hypothesis, term, fitted, float(evidence), gains / spread)


def cost_for(smaller: Fit, evidence: float) -> float:
    """Return the cost at which a larger model has so much evidence [nats], but for its penalty.

    What it misses scales evidence down. Where it leaves more than `MISSED_ALIKE` of what the
    smaller one leaves beyond noise, as much as for that, in proportion to the cost; else as if the
    rest were white.
    """
    before, twice, noise = smaller.cost, 2 * evidence, min(len(smaller.z), smaller.cost)
    alike = before / (1 + twice * max(1.0, smaller.spread) / before)
    most = noise + MISSED_ALIKE * (before - noise)
    white = min(most, before / (1 + twice / len(smaller.z)))
    return min(before - twice, alike if alike > most else white)


def gain_of(candidate: Candidate) -> float:
    """Return what a candidate explains [nats]: its evidence without the penalty for free values."""
    return candidate.evidence + occam_factor(candidate.fit, candidate.term)


def best_of(fitted: list[Candidate | None]) -> list[Candidate]:
    """Return the candidate with the highest evidence of each hypothesis, highest first."""
    out: dict[tuple[str, int], Candidate] = {}
    for candidate in sorted((c for c in fitted if c is not None), key=lambda c: -c.evidence):
        out.setdefault(candidate.hypothesis.key, candidate)
    return list(out.values())


def occam_factor(fitted: Fit, *terms: Term) -> float:
    """Return half the log of how much the data narrow the values of some terms, from broad
    priors."""
    mine = columns_of(fitted, *terms)
    rest = np.setdiff1d(np.arange(fitted.forward.size), mine)
    prior = fitted.prior
    information = fitted.jacobian.T @ fitted.jacobian + prior.information
    information += np.diag(np.where(prior.held, 0.0, 1e-12))
    others, cross = information[np.ix_(rest, rest)], information[np.ix_(rest, mine)]
    own = information[np.ix_(mine, mine)]
    own = own - cross.T @ np.linalg.pinv(others, hermitian=True) @ cross
    length = float(fitted.forward.base.properties.length.sum())
    broad = np.array(
        [
            PLACE_PRIOR_SD * length / s
            if term.effect and name in term.effect.place_names
            else SIZE_PRIOR_SD
            for term in terms
            for name, s in zip(term.names, term.scale, strict=True)
        ]
    )
    strength = np.linalg.eigvalsh(own * np.outer(broad, broad))
    return 0.5 * float(np.log1p(np.maximum(strength, 0.0)).sum())


def columns_of(fitted: Fit, *terms: Term) -> np.ndarray:
    """Return which search variables (k,) of a fit are those of some of its terms."""
    every = fitted.forward.terms
    parts = fitted.forward.split(np.arange(fitted.forward.size))
    return np.concatenate([
        next(part for term, part in zip(every, parts, strict=True) if term is one)
        for one in terms
    ])  # fmt: skip
