"""Estimates: what is known of every fitted parameter, whatever fitted it.

`profile.py` makes them of shapes at rest, `sandwich.py` of motions (by blocks of time) and of the
paper's losses (by frames and segments).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ropefit.inference.verdict import Verdict, at_bound, is_wide, verdict

WIDEST = 50.0  # of a logarithm: half an interval from which on there is none


@dataclass(frozen=True)
class Estimate:
    """One parameter, in SI of the setup: value, 95 % interval or none, 95 % upper limit of what is
    too small to be seen, verdict, and the names that it trades off with."""

    value: float
    verdict: Verdict
    interval: tuple[float, float] | None = None
    below: float | None = None
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Estimates:
    """The free parameters of a fit by name, in the order of the fit; correlation (n, n) of theirs,
    NaN where the data do not determine it; condition number of their scaled sensitivities, None
    where singular; sd (P,) of all search variables, those of calibration errors included."""

    of: dict[str, Estimate]
    correlation: np.ndarray
    condition: float | None
    sd: np.ndarray = field(repr=False)


Interval = tuple[float, float]
Profile = tuple[Interval | None, float | None, bool]


def estimate(
    value: Callable[[float], float],
    u: float,
    half: float,
    bounds: tuple[float, float],
    *,
    log: bool,
    converged: bool,
    dead: bool = False,
    partners: tuple[str, ...] = (),
    profile: Callable[[float, bool], Profile | None] | None = None,
) -> Estimate:
    """Return what is known of one parameter, by one rule for every model and every search.

    value: in SI of a search variable; u: the search variable, half: half of its 95 % interval, and
    its bounds; log: it is a logarithm. partners: what it trades off with. A fit that did not
    converge, a parameter that does nothing, and one at a bound have no interval: there is no
    minimum around which it would be one. profile: called with the value and whether the interval is
    wide, returns interval, upper limit and width by another way, or None to keep this one.
    """
    bounded, wide = at_bound(u, *bounds), is_wide(half, log, *bounds)
    interval, below = None, None
    if converged and not dead and not bounded:
        if half < WIDEST:
            interval = value(u - half), value(u + half)
        if profile and (found := profile(value(u), wide)):
            interval, below, wide = found
    judged = verdict(
        converged=converged, dead=dead, bounded=bounded, wide=wide, trades=bool(partners)
    )
    return Estimate(value(u), judged, interval, below, partners)


def correlation_of(covariance: np.ndarray) -> np.ndarray:
    """Return (P, P) correlation of a covariance (P, P)."""
    root = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return covariance / np.outer(root, root)


def condition_of(correlation: np.ndarray) -> float | None:
    """Return the condition number of the sensitivities from a correlation (n, n), None where
    singular."""
    if not correlation.size:
        return 1.0
    values = np.linalg.eigvalsh(correlation)
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else None
