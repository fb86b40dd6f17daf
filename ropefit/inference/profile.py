"""Intervals of a fit of shapes: by the parabola, and by profile where that cannot be trusted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ropefit.inference.intervals import (
    Estimates,
    Interval,
    Profile,
    condition_of,
    correlation_of,
    estimate,
)
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.verdict import NORMAL_QUANTILE, is_wide, partners
from ropefit.models.model import Model

ONE_SIDED = 1.645**2  # rise of χ² at a 95 % limit
TWO_SIDED = NORMAL_QUANTILE**2
NARROW = 0.3  # sd of a logarithm up to which the parabola is trusted for its interval
VANISHING = np.log(1e-3)  # a thousandth of the best value stands for nothing at all
DEAD = 1e-6  # whitened sensitivity, all stations together, of what does nothing


def profile_intervals(found: Fit) -> Estimates:
    """Return estimates of the rope parameters of a least-squares fit of shapes.

    From the parabola at the minimum where that is narrow; of a logarithm where it is not, by the
    rise of χ² with the parameter held and all others refitted.
    """
    out, place = {}, 0
    sd, (low, high) = found.sd(), found.forward.bounds()
    correlation = correlation_of(found.covariance)
    labels = [t.name for t in found.forward.terms for _ in range(t.size)]
    for term in found.forward.terms:
        if not term.nuisance and term.effect is None:
            trades, half = partners(correlation, place, labels), found.quantile * sd[place]
            by_profile = partial(_profile, found, place, half, bool(trades))
            out[term.name] = estimate(
                term.value_of, found.point.u[place], half, (low[place], high[place]), log=term.log,
                converged=found.converged, partners=trades,
                dead=float(np.linalg.norm(found.jacobian[:, place])) < DEAD,
                profile=by_profile if term.log else None,
            )  # fmt: skip
        place += term.size
    own = correlation[: len(out), : len(out)]
    return Estimates(out, own, condition_of(own), sd)


def _profile(
    found: Fit, k: int, half: float, trades: bool, value: float, wide: bool
) -> Profile | None:
    """Return what a profile says about the k-th search variable, a logarithm, where the parabola is
    not to be trusted for it.

    half, wide: the interval by the parabola; trades: whether the parameter trades off with others.
    """
    if half < found.quantile * NARROW or (wide and trades):
        return None
    interval, below = _limits(found, k, value)
    if interval is None:
        return None, below, True
    log_half = 0.5 * float(np.log(interval[1] / interval[0]))
    return interval, below, is_wide(log_half, True, -np.inf, np.inf)


def _limits(found: Fit, k: int, value: float) -> tuple[Interval | None, float | None]:
    """Return interval or upper limit, from the rise of χ² with the parameter held, others
    refitted."""

    def rise(shift: float) -> float:
        """Return the rise of χ², in units of the residual's own size, with the logarithm moved by
        `shift`."""
        held = _without(found.forward, k, found.point.u[k] + shift)
        start = np.delete(found.point.u, k)
        return (fit(held, found.problem, start, 15).cost - found.cost) / found.spread

    def crossing(goal: float, direction: float, most: float) -> float | None:
        inner, outer = 0.0, direction * 0.5
        while rise(outer) < goal:
            inner, outer = outer, 2 * outer
            if abs(outer) > most:
                return None
        for _ in range(8):
            middle = 0.5 * (inner + outer)
            if rise(middle) < goal:
                inner = middle
            else:
                outer = middle
        return 0.5 * (inner + outer)

    if rise(VANISHING) < TWO_SIDED:
        up = crossing(ONE_SIDED, 1.0, 12.0)
        if up is None:
            return None, None
        return None, value * float(np.exp(up))
    up, down = crossing(TWO_SIDED, 1.0, 12.0), crossing(TWO_SIDED, -1.0, 12.0)
    if up is None or down is None:
        return None, None
    return (value * float(np.exp(down)), value * float(np.exp(up))), None


def _without(forward: Model, k: int, held: float) -> Model:
    """Return the forward model with one of its one-value terms held at a search variable."""
    terms, place = [], 0
    base = forward.base
    for term in forward.terms:
        if place == k:
            base = term.apply(base, term.value(np.array([held])))
        else:
            terms.append(term)
        place += term.size
    return replace(forward, base=base, terms=terms)
