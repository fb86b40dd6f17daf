"""Where a fit sets out from, by one rule for every model and every search.

Starts are tried where a trial is cheap (few frames, few steps) and the best goes
on: one that cannot be simulated drops out, of equals the first goes on. A fit that is begun anew
replaces the one before it only where it costs less.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ropefit.inference.least_squares import Fit


def best_start(starts: Iterable[np.ndarray], trial: Callable[[np.ndarray], Fit]) -> Fit:
    """Return the best trial of some starts (P,). Raises ArithmeticError where none can be
    simulated."""
    best, failure = None, ArithmeticError("no start is given")
    for start in starts:
        try:
            found = trial(start)
        except ArithmeticError as error:
            failure = error
        else:
            best = cheaper(best, found) if best else found
    if best is None:
        raise failure
    return best


def cheaper(current: Fit, again: Fit, by: float = 0.0) -> Fit:
    """Return a fit that is begun anew if it costs less by more than this, else the current one."""
    return again if again.cost < current.cost - by else current


def ranked(losses: np.ndarray, most: int) -> np.ndarray:
    """Return (..., most) indices of the lowest of losses (..., n), lowest first; what failed (not
    a number) comes last."""
    failed = np.where(np.isnan(losses), np.inf, losses)
    return np.argsort(failed, axis=-1, kind="stable")[..., :most]
