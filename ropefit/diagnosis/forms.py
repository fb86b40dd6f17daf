"""Which form an accepted law has: its curve with a band, and formulas fitted in its place.

Every formula is fitted through the model like the law itself, and compared by its evidence. It is
named where the others, the law's free curve among them, are far behind, and its local exponent
d ln y / d ln x differs significantly from theirs somewhere in the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.diagnosis.candidate import EVALUATIONS, Candidate, columns_of, occam_factor
from ropefit.effects.law import Constant, Form, Law
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models.terms import Term

HOPELESS = 40.0  # nats behind the free curve: a form's fit without prospect of less is stopped
LEAST_LEAD = 6.0  # nats over every other form, of one that is named
POINTS = 61  # of a curve
DRAWS = 200  # of a band, and of the intervals of constants
WIDER = 1.5  # times the largest value of the data: where the curve ends
DEPARTURES = (0.1, 0.2, 0.4, 0.8, 1.6)  # sd of departures from a smooth curve that are tried
BROAD = 3.0  # usual sizes: sd of the prior of a smooth curve's values
LEAST_SHARE = 1e-3  # of the largest: smaller values of x are as good as zero
INSIDE = (0.02, 0.98)  # quantiles of the values of the data: where the curve is visited


@dataclass(frozen=True)
class Fitted:
    """A form in the law's place: evidence [nats] over the law's free curve; constants and their
    95 % intervals; y (DRAWS, n): its curve at x, the first of which is the best."""

    form: Form
    evidence: float
    constants: list[Constant]
    intervals: list[tuple[float, float]]
    y: np.ndarray


@dataclass(frozen=True)
class Described:
    """A law as the data show it: x (n,), y, low and high (n,) in SI; visited: the range of x in the
    data; forms that remain, best first; named: whether the first is the only one."""

    law: Law
    x: np.ndarray
    y: np.ndarray
    low: np.ndarray
    high: np.ndarray
    visited: tuple[float, float]
    forms: list[Fitted]
    named: bool


def described(candidate: Candidate, final: Fit) -> Described | None:
    """Return what is known of an accepted law; None of any other effect.

    final: the fit with all effects. Each form is one more fit.
    """
    law = candidate.hypothesis.effect.law(final.point.setup)
    if law is None:
        return None
    values = law.visited(final.point.setup, final.point.solution.x)
    least, most = (float(q) for q in np.quantile(values, INSIDE))
    least = least if law.even else max(least, LEAST_SHARE * most)
    x = _places(law, least, values)
    mine = columns_of(final, candidate.term)
    mean, covariance = _smooth(final, candidate.term, mine, law)
    drawn = _draws(final, mean, covariance)
    y = np.stack([law.curve(final.forward.setup_at(u), x) for u in drawn])
    spread = max(1.0, final.spread)
    free = -0.5 * final.cost / spread - occam_factor(final, candidate.term)
    inside = (x >= least) & (x <= most)
    tried = (_fitted(f, law, candidate.term, final, mean, x, inside) for f in law.forms)
    found = [replace(f, evidence=f.evidence - free) for f in tried if f is not None]
    found.sort(key=lambda f: -f.evidence)
    most_likely = max([0.0, *(f.evidence for f in found)])
    remaining = [
        f
        for f in found
        if f.evidence > most_likely - LEAST_LEAD
        or (
            most_likely == found[0].evidence
            and not exponents_differ(
                x if law.even else np.log(np.maximum(x, 1e-300)), inside, found[0].y, f.y
            )
        )
    ]
    named = len(remaining) == 1
    y = remaining[0].y if named else y
    low, high = np.quantile(y, (0.025, 0.975), axis=0)
    return Described(law, x, y[0], low, high, (least, most), remaining, named)


def _places(law: Law, least: float, values: np.ndarray) -> np.ndarray:
    """Return (POINTS,) where the curve is reported: from the `least` of values (n,) that counts."""
    if law.even:
        low, high = values.min(), values.max()
        more = 0.5 * (WIDER - 1) * (high - low)
        return np.linspace(low - more, high + more, POINTS)
    x = np.geomspace(0.1 * least if law.from_zero else least / WIDER, WIDER * values.max(), POINTS)
    x[0] = 0.0 if law.from_zero else x[0]
    return x


def exponents_differ(x: np.ndarray, inside: np.ndarray, a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether the 95 % intervals of d ln y / dx of two curves exclude one another anywhere
    `inside` (n,): draws (D, n) at x (n,)."""
    way = x[inside]
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = [
            np.quantile(
                np.gradient(np.log(np.abs(y[:, inside])), way, axis=1), (0.025, 0.975), axis=0
            )
            for y in (a, b)
        ]
    return bool(((ends[0][0] > ends[1][1]) | (ends[1][0] > ends[0][1])).any())


def _smooth(final: Fit, term: Term, mine: np.ndarray, law: Law) -> tuple[np.ndarray, np.ndarray]:
    """Return the search variables (P,) and their covariance with a prior of smoothness, its
    strength that of the highest evidence (Laplace's approximation about the fit). A law without
    departures from a smooth curve stays as it was fitted."""
    spread = max(1.0, final.spread)
    data = final.jacobian.T @ final.jacobian / spread + final.prior.information
    data += np.diag(np.where(final.prior.held, 0.0, 1e-9))
    others = np.setdiff1d(np.arange(len(data)), mine)
    cross = data[np.ix_(others, mine)]
    known = np.linalg.pinv(data[np.ix_(others, others)], hermitian=True)
    own = data[np.ix_(mine, mine)] - cross.T @ known @ cross
    zero = term.search(np.zeros(term.size))
    at = final.point.u[mine] - zero

    def precision(departure: float) -> np.ndarray:
        return np.where(law.smooth, BROAD**-2, (departure / term.scale) ** -2.0)

    def evidence(departure: float) -> float:
        prior = precision(departure)
        mean = np.linalg.solve(own + np.diag(prior), own @ at)
        left = at - mean
        fit = left @ own @ left + mean @ (prior * mean)
        size = np.linalg.slogdet(np.eye(len(at)) + own / prior)[1]
        return -0.5 * float(fit + size)

    prior = precision(max(DEPARTURES, key=evidence))
    whole = data.copy()
    whole[mine, mine] += prior
    if law.smooth.all():
        return final.point.u, np.linalg.pinv(whole, hermitian=True)
    pull = np.zeros(len(data))
    pull[mine] = prior * at
    covariance = np.linalg.pinv(whole, hermitian=True)
    return final.point.u - covariance @ pull, covariance


def _draws(final: Fit, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return (DRAWS, P) search variables within their bounds, the mean first."""
    rng = np.random.default_rng(0)
    low, high = final.forward.bounds()
    values, vectors = np.linalg.eigh(covariance)
    steps = rng.normal(size=(DRAWS, len(mean))) * np.sqrt(np.maximum(values, 0.0))
    steps[0] = 0.0
    return np.clip(mean + steps @ vectors.T, low, high)


def _factor(law: Law, y: np.ndarray, wanted: np.ndarray) -> float:
    """Return by what a form's curve (n,) is to be multiplied to be most like another one."""
    if law.even:
        return float(y @ wanted / (y @ y))
    return float(np.exp(np.mean(np.log(wanted / y))))


def _with_inexact(constant: Constant, low: float, high: float) -> tuple[float, float]:
    """Return a 95 % interval with the constant's error that is none of noise."""
    value, more = constant.value, NORMAL_QUANTILE * constant.inexact * constant.value
    if more == 0.0:
        return float(low), float(high)
    return float(value - np.hypot(value - low, more)), float(value + np.hypot(high - value, more))


def _fitted(
    form: Form,
    law: Law,
    term: Term,
    final: Fit,
    mean: np.ndarray,
    x: np.ndarray,
    inside: np.ndarray,
) -> Fitted | None:
    """Return a form fitted in the law's place, with its own log evidence; None where that fails.

    It begins with those of its tries whose curve is most like that of the law `inside` the data.
    """
    model, mine = final.forward, columns_of(final, term)
    begin = final.point.u[np.setdiff1d(np.arange(len(mean)), mine)]  # where the rope settles
    without = model.with_terms([t for t in model.terms if t is not term])
    plain, wanted = without.setup_at(begin), law.curve(model.setup_at(mean), x[inside])

    def misfit(values: np.ndarray) -> float:
        y = law.curve(form.apply(plain, values), x[inside])
        if law.even:
            return float(np.square(wanted - _factor(law, y, wanted) * y).sum())
        return float(np.var(np.log(y / wanted)))

    start, size, scale = min(form.tries, key=misfit), len(form.names), form.scale
    if scale is None:
        scale = start
    else:
        y = law.curve(form.apply(plain, start), x[inside])
        start = start.copy()
        start[0] *= _factor(law, y, wanted)
    own = Term(
        form.name, form.names, form.units, form.apply, start, scale, form.lower, form.upper,
        np.full(size, np.inf), log=form.scale is None,
    )  # fmt: skip
    forward = model.with_terms([*without.terms, own], final.point.solution)
    begin = np.concatenate([begin, np.zeros(size)])
    needed = final.cost + 2 * HOPELESS * max(1.0, final.spread)
    fitted = attempted(forward, final.problem, begin, EVALUATIONS, 1e-5, needed)
    if fitted is None or fitted.stopped or len(fitted.z) != len(final.z):
        return None
    if not fitted.point.converged.all():
        return None
    spread = max(1.0, final.spread)
    evidence = -0.5 * fitted.cost / spread - occam_factor(fitted, own)
    drawn = _draws(fitted, fitted.point.u, fitted.covariance)
    setups = [fitted.forward.setup_at(u) for u in drawn]
    pairs = list(zip(setups, drawn, strict=True))
    every = [form.constants(s, own.value(u[-size:])) for s, u in pairs]
    ends = np.quantile([[c.value for c in row] for row in every], (0.025, 0.975), axis=0).T
    intervals = [_with_inexact(c, *end) for c, end in zip(every[0], ends, strict=True)]
    y = np.stack([law.curve(s, x) for s in setups])
    return Fitted(form, evidence, every[0], intervals, y)
