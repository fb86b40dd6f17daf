"""From a fit to the parameters of model.h5: one writer for every model and every search."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ropefit.adapters.units import Stated
from ropefit.artifacts import Parameter, ParameterGroup
from ropefit.inference.intervals import Estimate, Estimates
from ropefit.models.parameters import Range


@dataclass(frozen=True)
class Outcome:
    """How a fit went: the loss where it set out and where it ended, in which unit, evaluations,
    whether it converged, and why it stopped."""

    before: float
    after: float
    unit: Literal["m", "chi-square"]
    evaluations: int
    converged: bool
    reason: str


def parameter_group(
    frames: np.ndarray,
    estimates: Estimates,
    fixed: dict[str, float],
    ranges: dict[str, Range],
    stated: dict[str, Stated],
    outcome: Outcome,
) -> ParameterGroup:
    """Return the parameters of one fit as they are kept.

    frames (M,): numbers of the frames that it is of. estimates and fixed, by name, in SI of the
    setup: what was fitted, and what was not; ranges: where each set out, and its bounds.
    """
    every = {name: Estimate(value, "determined") for name, value in fixed.items()} | estimates.of
    parameters = {}
    for name in ranges:
        if name not in every or not np.isfinite(every[name].value):
            continue  # a rope that does not stretch has no EA
        found, (start, low, high), free = every[name], ranges[name], name in estimates.of
        factor, unit, meaning = stated[name]
        interval = found.interval
        parameters[name] = Parameter(
            meaning=meaning,
            unit=unit,
            initial=factor * (start if np.isfinite(start) else found.value),
            value=factor * found.value,
            lower=factor * low,
            upper=factor * high,
            free=free,
            verdict=found.verdict if free else "fixed",
            ci95=None if interval is None else (factor * interval[0], factor * interval[1]),
            below=None if found.below is None else factor * found.below,
            trades_with=list(found.partners),
        )
    return ParameterGroup(
        frames=frames,
        parameters=parameters,
        free_names=list(estimates.of),
        correlation=estimates.correlation,
        condition=estimates.condition,
        loss_before=outcome.before,
        loss_after=outcome.after,
        loss_unit=outcome.unit,
        evaluations=outcome.evaluations,
        converged=outcome.converged,
        stop_reason=outcome.reason,
    )


def outcome_of_fit(trace: list[float], cost: float, evaluations: int, converged: bool) -> Outcome:
    """Return how a least-squares fit went."""
    reason = "residual no longer decreases" if converged else "evaluation limit"
    return Outcome(trace[0], cost, "chi-square", evaluations, converged, reason)
