"""A candidate: a hypothesis fitted in full on top of a model, with its log evidence over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.calm import calm
from ropefit.diagnosis.held_out import block_losses, by_stretches
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.scan import Projection
from ropefit.inference.known import settled
from ropefit.inference.least_squares import NORMAL_QUANTILE, Fit, attempted, sensitivity
from ropefit.models.terms import Term

SIZE_PRIOR_SD = 3.0  # usual sizes
PLACE_PRIOR_SD = 0.29  # of the length: sd of a uniform place
START_SHARES = (1.0, 0.4, 0.15)  # of a start's size, until every frame settles
EVALUATIONS = 25
SLOW_EVALUATIONS = 6  # of a slow fit, in which it must gain something
SLOW_ROUNDS = 4  # so often it is continued
SLOW_COST, SLOW_SHARE = 4.0, 0.05  # least gain of a round: cost, and share of all gained so far
LATE_GAIN = 3.0  # nats: least first-order gain from which a late effect is fitted
DISTORTED_SD = 6.0  # prior sd: a calibration error beyond stands for what the model lacks
UNMOVED = 1e-8  # m
INSENSITIVE = 1.0  # whitened change of all data by a factor e of a parameter
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
        along = np.where(self._pointing(), self._raw() / self.term.scale, 0.0)
        if along.any():  # across a direction: its length changes nothing
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

    def magnitude(self) -> tuple[float, float]:
        """Return the length of a vector of sizes, and its standard error, in SI."""
        k = self.hypothesis.size
        values, slope = self.values()[:k], self.term.slope(self._mine(self.fit.point.u))[:k]
        size = float(np.linalg.norm(values))
        along = slope * values / max(size, 1e-300)
        return size, float(np.sqrt(max(along @ self.covariance()[:k, :k] @ along, 0.0)))

    def _raw(self) -> np.ndarray:
        """Return (k + p,) values in SI as they were fitted."""
        return self.term.value(self._mine(self.fit.point.u))

    def _pointing(self) -> np.ndarray:
        """Return (k + p,) bool: components of a direction."""
        return np.isin(self.term.names, self.hypothesis.effect.direction)

    def _length(self) -> np.ndarray:
        """Return (k + p,) the length of the direction for its components, else 1."""
        pointing = self._pointing()
        return np.where(pointing, np.linalg.norm(self._raw()[pointing]), 1.0)

    def _mine(self, u: np.ndarray) -> np.ndarray:
        """Return its part of the fit's values (P,), whatever was added to the model after it."""
        forward = self.fit.forward
        parts = zip(forward.terms, forward.split(u), strict=True)
        return next(part for term, part in parts if term is self.term)


def fit_candidate(
    smaller: Fit, hypothesis: Hypothesis, start: np.ndarray, lowest: float = np.inf,
    needed: float = np.inf, evaluations: int = EVALUATIONS,
) -> Candidate | None:  # fmt: skip
    """Fit a hypothesis on top of a model, from `start` (k + p,) in SI. None if it cannot settle.

    lowest: cost of the best other candidate; a slow fit that cannot reach it is not continued.
    needed: cost that makes a difference; a fit without prospect of it is stopped.
    """
    setup, slow = smaller.forward.base, hypothesis.effect.slow
    origin = calm(smaller) if slow else smaller
    limits = hypothesis.term(setup, start)
    for share in START_SHARES if hypothesis.effect.linear else (1.0,):
        at = start * np.where(np.arange(len(start)) < hypothesis.size, share, 1.0)
        term = hypothesis.term(setup, np.clip(at, limits.lower + 1e-9, limits.upper - 1e-9))
        forward = smaller.forward.with_terms([*smaller.forward.terms, term], origin.point.solution)
        begin = np.concatenate([_revived(origin), np.zeros(term.size)])
        first = settled(forward, begin)
        if first.converged.all() and first.setup.possible:
            break
    else:
        return None
    moved = _whitened_change(smaller, first.seen)
    if hypothesis.effect.late and _gain_along(smaller, moved) < LATE_GAIN:
        return None
    if origin is smaller and _distorted(smaller):
        begin[: -term.size] = _refitted_beside(smaller, moved)
    if slow and np.allclose(first.seen, origin.point.seen, rtol=0, atol=UNMOVED, equal_nan=True):
        return None  # nothing is touched: there is no gradient
    most = SLOW_EVALUATIONS if slow else evaluations
    needed = np.inf if slow else needed  # contact has no linear steps
    fitted = attempted(forward, smaller.problem, begin, most, tolerance=1e-5, needed=needed)
    if slow and fitted is not None and fitted.cost < smaller.cost:
        fitted = _continued(smaller.cost, fitted, lowest)
    return _comparable(hypothesis, term, smaller, fitted)


def continued(
    candidate: Candidate, smaller: Fit, evaluations: int, needed: float
) -> Candidate | None:
    """Fit a candidate on top of a model further; see `fit_candidate`."""
    fitted = candidate.fit
    again = attempted(
        fitted.forward, fitted.problem, fitted.point.u, evaluations, tolerance=1e-5, needed=needed
    )
    return _comparable(candidate.hypothesis, candidate.term, smaller, again)


def _comparable(
    hypothesis: Hypothesis, term: Term, smaller: Fit, fitted: Fit | None
) -> Candidate | None:
    """Return the candidate, if its frames settle as those of the smaller model do."""
    if fitted is None or not np.isfinite(fitted.cost) or not fitted.point.converged.all():
        return None
    if len(fitted.z) != len(smaller.z):  # a frame did not settle at the start: no comparison
        return None
    return compared(hypothesis, term, smaller, fitted)


def _continued(before: float, fitted: Fit, lowest: float) -> Fit:
    """Continue a slow fit as long as it gains: contact comes and goes, and gains soon
    shrink. One that even at its present pace could not reach the cost `lowest` stays as it is."""
    for left in range(SLOW_ROUNDS, 0, -1):
        if fitted.converged or fitted.cost - left * SLOW_EVALUATIONS * _pace(fitted) > lowest:
            break
        again = attempted(
            fitted.forward, fitted.problem, fitted.point.u, SLOW_EVALUATIONS, tolerance=1e-4
        )
        least = max(SLOW_COST, SLOW_SHARE * (before - fitted.cost))
        if again is None or again.cost > fitted.cost - least:
            break
        fitted = again
    return fitted


def _pace(fitted: Fit) -> float:
    """Return how much each evaluation in the second half of a fit has lowered its cost."""
    half = len(fitted.trace) // 2
    return (min(fitted.trace[: half + 1]) - fitted.cost) / max(len(fitted.trace) - 1 - half, 1)


def compared(hypothesis: Hypothesis, term: Term, smaller: Fit, fitted: Fit) -> Candidate:
    """Compare a fitted hypothesis, its term the last one, with the smaller model.

    The log evidence is Laplace's approximation, with broad priors; what even the larger model
    misses scales it down.
    """
    spread = max(1.0, fitted.spread)
    evidence = 0.5 * (smaller.cost - fitted.cost) / spread - occam_factor(fitted, term)
    along = by_stretches(fitted)
    gains = block_losses(smaller, along) - block_losses(fitted, along)
    return Candidate(hypothesis, term, fitted, float(evidence), gains / spread)


def best_of(fitted: list[Candidate | None]) -> list[Candidate]:
    """Return the candidate with the highest evidence of each hypothesis, highest first."""
    out: dict[tuple[str, int], Candidate] = {}
    for candidate in sorted((c for c in fitted if c is not None), key=lambda c: -c.evidence):
        out.setdefault(candidate.hypothesis.key, candidate)
    return list(out.values())


def _revived(smaller: Fit) -> np.ndarray:
    """Return (P,) where a larger model starts: at the smaller one's values.

    Positive parameters without a prior that ran to where the data are insensitive to them start
    anew: without a gradient they would stay there. (A rope that is too short becomes as soft as
    its bounds allow.)
    """
    u, terms = smaller.point.u.copy(), smaller.forward.terms
    logs = np.repeat([t.log for t in terms], [t.size for t in terms])
    unseen = np.linalg.norm(smaller.jacobian, axis=0) < INSENSITIVE
    u[logs & unseen & ~np.isfinite(smaller.prior)] = 0.0
    return u


def _distorted(smaller: Fit) -> bool:
    """Return whether a calibration error is too large to be one: it stands for missing physics."""
    held = np.isfinite(smaller.prior)
    return bool((np.abs(smaller.point.u[held]) > DISTORTED_SD * smaller.prior[held]).any())


def _whitened_change(smaller: Fit, seen: np.ndarray) -> np.ndarray:
    """Return (M D,) by how much an effect that makes the rope `seen` (F, K, 3) changes it."""
    s = smaller.stations
    return sensitivity((seen - smaller.point.seen)[None], s, s, smaller.whitener)[:, 0]


def _gain_along(smaller: Fit, moved: np.ndarray) -> float:
    """Return by how many nats an effect that moves the rope along `moved` (M D,), by whatever
    multiple of it, would lower the misfit, to first order; the smaller model refitted."""
    project = Projection(smaller)
    kept = project(moved)
    return float(0.5 * (moved @ project.z) ** 2 / max(moved @ kept, 1e-300))


def _refitted_beside(smaller: Fit, moved: np.ndarray) -> np.ndarray:
    """Return (P,) the best values of the smaller model, to first order, beside an effect that
    moves its rope by `moved` (M D,): they need not stand for that effect any more."""
    u = smaller.point.u
    project = Projection(smaller)
    held = np.isfinite(smaller.prior)
    pull = np.where(held, u / smaller.prior**2, 0.0)
    step = project.inverse @ (project.jacobian.T @ (smaller.z - moved) - pull)
    low, high = smaller.forward.bounds()
    return np.clip(u + step, low, high)


def occam_factor(fitted: Fit, *terms: Term) -> float:
    """Return half the log of how much the data narrow the values of the last terms, from broad
    priors."""
    k = sum(term.size for term in terms)
    held = np.isfinite(fitted.prior)
    information = fitted.jacobian.T @ fitted.jacobian + np.diag(
        np.where(held, 1 / fitted.prior**2, 1e-12)
    )
    others = information[:-k, :-k]
    cross = information[:-k, -k:]
    own = information[-k:, -k:] - cross.T @ np.linalg.pinv(others, hermitian=True) @ cross
    length = float(fitted.forward.base.properties.length.sum())
    prior = np.array(
        [
            PLACE_PRIOR_SD * length / s
            if term.effect and name in term.effect.place_names
            else SIZE_PRIOR_SD
            for term in terms
            for name, s in zip(term.names, term.scale, strict=True)
        ]
    )
    strength = np.linalg.eigvalsh(own * np.outer(prior, prior))
    return 0.5 * float(np.log1p(np.maximum(strength, 0.0)).sum())
