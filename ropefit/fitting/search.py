"""A gradient or grid search as a stage runs it, told with its uncertainty."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.artifacts import Observations, Parameter, ParameterGroup
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference import minimise
from ropefit.inference.identify import Task, gradient_search, grid_search, uncertainty
from ropefit.inference.minimise import Search
from ropefit.inference.uncertainty import verdicts
from ropefit.runs.protocol import Context

FLAT = np.log(3.0)  # an interval beyond a factor of three up and down determines nothing


def run_search(task: Task, settings: IdentifySettings, context: Context) -> Search:
    """Run the search."""
    goal = settings.evaluations if settings.how == "gradient" else settings.rounds

    def report(search: Search) -> None:
        done = search.evaluations if settings.how == "gradient" else int(search.calm[0])
        context.progress(0.9 * done / goal, f"{settings.loss} {float(search.loss.min()):.4g} m")

    if settings.how == "gradient":
        return gradient_search(task, settings.evaluations, report)
    return grid_search(task, settings.levels, settings.rounds, report)


def describe(
    task: Task,
    values: np.ndarray,
    search: Search,
    number: int,
    observations: Observations,
    member: np.ndarray,
    meaning: dict[str, str],
    told: dict[str, tuple[float, str]] | None = None,
) -> ParameterGroup:
    """Intervals and verdicts of one group's parameters.

    values (n,); member (F,) bool: the group's frames; told: factor and unit in which each parameter
    is told, if not as it is.
    """
    space = task.space
    floor = float(np.median(observations.noise))
    found = uncertainty(task, values, floor, observations.length)
    judged = verdicts(found, space.at_bound(values), FLAT)
    with torch.no_grad():
        start = task.loss(space.to_search(space.start[None]), torch.zeros(1, dtype=torch.int64))
    parameters = {}
    for i, name in enumerate(space.names):
        if not np.isfinite(values[i]):
            continue  # a rope that does not stretch has no EA to tell
        factor, unit = (told or {}).get(name, (1.0, "1"))
        place = space.free.index(i) if i in space.free else None
        interval, verdict, partners = None, "fixed", []
        if place is not None and not search.converged[number]:
            verdict = "not converged"
        elif place is not None:
            verdict, partners = judged[place]
            width = found.half_width[place]
            if np.isfinite(width) and width < 50:
                middle = factor * values[i]
                interval = (middle * np.exp(-width), middle * np.exp(width))
        parameters[name] = Parameter(
            meaning=meaning[name],
            unit=unit,
            initial=factor * space.start[i],
            value=factor * values[i],
            lower=factor * space.lower[i],
            upper=factor * space.upper[i],
            free=place is not None,
            verdict=verdict,
            ci95=interval,
            trades_with=[space.free_names[j] for j in partners],
        )
    return ParameterGroup(
        frames=observations.frames[member],
        parameters=parameters,
        free_names=space.free_names,
        correlation=found.correlation,
        condition=found.condition if np.isfinite(found.condition) else None,
        loss_before=float(start[0]),
        loss_after=float(search.loss[number]),
        evaluations=search.evaluations,
        converged=bool(search.converged[number]),
        stop_reason=minimise.REASONS[int(search.status[number])],
    )
