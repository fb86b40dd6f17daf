"""Intervals of a fit of shapes: by the parabola, and by profile where that cannot be trusted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ropefit.inference.intervals import WIDEST, Estimate, Estimates, condition_of, correlation_of
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.verdict import at_bound, is_wide, partners, verdict
from ropefit.models.model import Model
from ropefit.models.terms import Term

ONE_SIDED = 1.645**2  # rise of χ² at a 95 % limit
TWO_SIDED = 1.96**2
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
            trades = partners(correlation, place, labels)
            out[term.name] = _estimate(
                found, place, term, found.quantile * sd[place], trades,
                (low[place], high[place]),
            )  # fmt: skip
        place += term.size
    own = correlation[: len(out), : len(out)]
    return Estimates(out, own, condition_of(own), sd)


def _estimate(
    found: Fit, k: int, term: Term, half: float, trades: tuple[str, ...],
    bounds: tuple[float, float],
) -> Estimate:  # fmt: skip
    """Return the k-th search variable, of a rope parameter; half: of its interval by the
    parabola."""
    u = found.point.u[k]
    around = (u, u - min(half, WIDEST), u + min(half, WIDEST))
    value, least, most = (float(term.value(np.array([v]))[0]) for v in around)
    dead = float(np.linalg.norm(found.jacobian[:, k])) < DEAD
    bounded, wide = at_bound(u, *bounds), is_wide(half, term.log, *bounds)
    interval = (least, most) if half < WIDEST or not term.log else None
    below = None
    trusted = not term.log or half < found.quantile * NARROW or (wide and bool(trades))
    if not (dead or bounded or trusted) and found.converged:
        interval, below = _profile(found, k, value)
        wide = interval is None or is_wide(
            0.5 * float(np.log(interval[1] / interval[0])), True, *bounds
        )
    judged = verdict(
        converged=found.converged, dead=dead, bounded=bounded, wide=wide, trades=bool(trades)
    )
    if dead or bounded:
        interval = None
    return Estimate(value, judged, interval, below, trades)


def _profile(found: Fit, k: int, value: float) -> tuple[tuple[float, float] | None, float | None]:
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
            base = term.apply(base, torch.from_numpy(term.value(np.array([held]))))
        else:
            terms.append(term)
        place += term.size
    return replace(forward, base=base, terms=terms)
