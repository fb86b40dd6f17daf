"""What may be said of a fitted parameter: interval, verdict, or a limit where it has no effect."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.sandwich import STRONG, Verdict
from ropefit.models.equilibrium import Forward

ONE_SIDED = 1.645**2  # rise of χ² at a 95 % limit
TWO_SIDED = 1.96**2
NARROW = 0.3  # sd of a logarithm up to which the parabola is trusted for its interval
VANISHING = np.log(1e-3)  # a thousandth of the best value stands for nothing at all
WIDEST = 50.0  # of a logarithm: an interval beyond says nothing
VAGUE = 0.5  # of the range: an interval as wide says nothing of a value that may be zero
DEAD = 1e-6  # whitened sensitivity, all stations together, of what does nothing


@dataclass(frozen=True)
class Limits:
    """In SI: value, 95 % interval or none, upper limit or none; verdict; names it trades with."""

    value: float
    interval: tuple[float, float] | None
    below: float | None
    verdict: Verdict
    partners: tuple[str, ...]


def limits(result: Fit, data: Data, noise: Noise, bins: int) -> dict[str, Limits]:
    """For every rope parameter of a fit: on a log scale, or of either sign."""
    out, place = {}, 0
    covariance, sd = result.covariance, result.sd()
    low, high = result.forward.bounds()
    labels = [f"{t.name}" for t in result.forward.terms for _ in range(t.size)]
    for term in result.forward.terms:
        if term.nuisance:
            place += term.size
            continue
        u, k = result.point.u[place], place
        value = float(term.value(np.array([u]))[0])
        strength = float(np.linalg.norm(result.jacobian[:, k]))
        width = result.quantile * sd[k]
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = covariance[k] / (sd[k] * sd)
        partners = tuple(
            sorted({labels[j] for j in range(len(sd)) if j != k and abs(correlation[j]) > STRONG})
        )
        interval: tuple[float, float] | None = None
        if width < WIDEST:
            interval = value * float(np.exp(-width)), value * float(np.exp(width))
        below, verdict = None, "determined"
        if not term.log:
            half = width * float(term.scale[0])
            interval = (value - half, value + half)
        if strength < DEAD:
            interval, verdict = None, "dead"
        elif min(u - low[k], high[k] - u) < 0.005 * (high[k] - low[k]):
            interval, verdict = None, "at bound"
        elif not term.log:
            if 2 * width > VAGUE * (high[k] - low[k]):
                verdict = "trade-off" if partners else "flat direction"
        elif partners and sd[k] > NARROW:
            verdict = "trade-off"
        elif sd[k] > NARROW:
            interval, below, verdict = _profile(result, k, value, data, noise, bins)
        out[term.name] = Limits(value, interval, below, verdict, partners)
        place += term.size
    return out


def _profile(
    result: Fit, k: int, value: float, data: Data, noise: Noise, bins: int
) -> tuple[tuple[float, float] | None, float | None, Verdict]:
    """Interval, or upper limit, from the rise of χ² with the parameter held, others refitted."""
    spread = max(result.scale**2, 1e-12)

    def rise(shift: float) -> float:
        """Of χ², in units of the residual's own size, with the logarithm moved by `shift`."""
        held = _without(result.forward, k, result.point.u[k] + shift)
        start = np.delete(result.point.u, k)
        return (fit(held, data, noise, bins, start, 15).cost - result.cost) / spread

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
            return None, None, "flat direction"
        return None, value * float(np.exp(up)), "flat direction"
    up, down = crossing(TWO_SIDED, 1.0, 12.0), crossing(TWO_SIDED, -1.0, 12.0)
    if up is None or down is None:
        return None, None, "flat direction"
    return (value * float(np.exp(down)), value * float(np.exp(up))), None, "determined"


def _without(forward: Forward, k: int, held: float) -> Forward:
    """The forward model with one of its one-value terms held at a search variable."""
    terms, place = [], 0
    base = forward.base
    for term in forward.terms:
        if place == k:
            base = term.apply(base, torch.from_numpy(term.value(np.array([held]))))
        else:
            terms.append(term)
        place += term.size
    return replace(forward, base=base, terms=terms)
