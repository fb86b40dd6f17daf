"""What may be said of a fitted parameter, by one rule for every model and every search."""

from __future__ import annotations

from typing import Literal

import numpy as np

Verdict = Literal["determined", "trade-off", "flat direction", "dead", "at bound", "not converged"]
NORMAL_QUANTILE = 1.959964  # standard deviations: half of a 95 % interval
STRONG_CORRELATION = 0.98  # from which two parameters trade off
WIDE_LOGARITHM = np.log(3.0)  # half width: an interval beyond a factor of three determines nothing
WIDE_SHARE = 0.25  # of the range: half width of a value of either sign that determines nothing
AT_BOUND = 0.005  # of the range of the search variable


def verdict(*, converged: bool, dead: bool, bounded: bool, wide: bool, trades: bool) -> Verdict:
    """Return the verdict on one parameter.

    dead: nothing depends on it; bounded: it lies at a bound; wide: its 95 % interval determines
    nothing; trades: it is strongly correlated with others. A narrow interval already accounts for
    correlation: such a parameter is determined.
    """
    if not converged:
        return "not converged"
    if dead:
        return "dead"
    if bounded:
        return "at bound"
    if not wide:
        return "determined"
    return "trade-off" if trades else "flat direction"


def at_bound(value: float, lower: float, upper: float) -> bool:
    """Return whether a search variable lies at one of its bounds."""
    return min(value - lower, upper - value) < AT_BOUND * (upper - lower)


def is_wide(half: float, log: bool, lower: float, upper: float) -> bool:
    """Return whether an interval determines nothing.

    half: its half width in the search variable, whose bounds are lower and upper; log: that is a
    logarithm.
    """
    return not half <= (WIDE_LOGARITHM if log else WIDE_SHARE * (upper - lower))


def partners(correlation: np.ndarray, k: int, labels: list[str]) -> tuple[str, ...]:
    """Return the names (sorted) of those with which parameter k trades off, by correlation (P, P)
    of parameters with these labels (P)."""
    strong = np.abs(np.nan_to_num(correlation[k])) > STRONG_CORRELATION
    strong[k] = False
    return tuple(sorted({labels[j] for j in np.flatnonzero(strong)}))
