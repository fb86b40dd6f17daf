"""Short predictions of a motion, each begun anew from what was observed.

What they miss is new in every part (innovations). An open-loop prediction gathers phase and drift
over seconds, which a wrong cause can trade for one another; over a short horizon it cannot.
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit
from ropefit.inference.problem import FitProblem
from ropefit.models.model import Model

SHORT = 0.4  # s
MOST_SECONDS = 12.0  # of motion that is looked at over horizons
MOST_RMS_RATIO = 1.01  # of what short predictions miss, over that without a cause


def over_horizons(seconds: float, forward: Model, problem: FitProblem) -> tuple[Model, FitProblem]:
    """Return a model that predicts no further than this, in parts of together `MOST_SECONDS` at
    most, and the problem of the frames in them."""
    parts = forward.horizon(seconds, MOST_SECONDS)
    reached = np.isin(np.arange(len(problem.data.points)), np.concatenate(parts.clips))
    return parts, problem.without(~reached)


def innovations_rms(fitted: Fit) -> float:
    """Return the rms distance [m] by which short predictions, with a fit's values, miss the
    points. It is simulated once."""
    if fitted.innovations is None:
        parts, problem = over_horizons(SHORT, fitted.forward, fitted.problem)
        residual = problem.match(parts.at(fitted.point.u).seen).residual
        fitted.innovations = float(np.sqrt((residual**2).sum(axis=1).mean()))
    return fitted.innovations


def contradicted(fitted: Fit, smaller: Fit) -> bool:
    """Return whether short predictions miss a motion by more with the values of a fit than with
    those of the model without its last effect, or cannot be simulated with them."""
    if fitted.forward.instantaneous:
        return False
    return not innovations_rms(fitted) <= MOST_RMS_RATIO * innovations_rms(smaller)
