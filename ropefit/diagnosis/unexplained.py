"""What a fit leaves of a recording beyond noise."""

from __future__ import annotations

import numpy as np

from ropefit.effects.base import MAY_LEAVE
from ropefit.inference.least_squares import Fit

LEFT_SD = 3.0  # standard errors of χ²: more is left by something
# Times the variance of what a rope is missed by in the recording that it is known from: as much
# differs from one load to another.
UNLIKE_ELSEWHERE = 2.0


def explained(smaller: Fit, fitted: Fit) -> bool:
    """Return whether a fit leaves next to nothing of what a smaller model leaves."""
    return unexplained(fitted) <= MAY_LEAVE * unexplained(smaller)


def unexplained(fitted: Fit) -> float:
    """Return the χ² in excess of what noise alone has."""
    return float(fitted.z @ fitted.z) - len(fitted.z)


def leaves_something(fitted: Fit, sd: float = LEFT_SD) -> bool:
    """Return whether a fit leaves more than noise alone may, by so many standard errors of χ²."""
    return unexplained(fitted) > sd * np.sqrt(2 * len(fitted.z))


def may_lack_more(fitted: Fit) -> bool:
    """Return whether further effects are worth a search of pairs: a rope at rest leaves more than
    noise alone may; of one that is known from another recording, and is missed by more than noise
    there, also more than there."""
    least = (UNLIKE_ELSEWHERE - 1) * len(fitted.z) if fitted.problem.noise.misfit else 0.0
    return bool(leaves_something(fitted) and unexplained(fitted) > least)


def misses_more_than_elsewhere(fitted: Fit) -> bool:
    """Return whether a rope at rest is missed by significantly more than in the recording that it
    is known from."""
    by_chance = LEFT_SD * np.sqrt(2 * fitted.problem.noise.repeats / len(fitted.z))
    return fitted.spread > max(UNLIKE_ELSEWHERE, 1 + by_chance)
