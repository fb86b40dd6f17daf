"""A gradient or grid search as a stage runs it, reported with its uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ropefit.adapters.parameter_group import Outcome, parameter_group
from ropefit.adapters.units import Stated
from ropefit.artifacts import Observations, ParameterGroup
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference import bfgs
from ropefit.inference.bfgs import Search
from ropefit.inference.identify import Task, gradient_search, grid_search, uncertainty
from ropefit.inference.sandwich import cluster_estimates
from ropefit.models.parameters import Range
from ropefit.runs.protocol import Context


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
    task: Task, values: np.ndarray, search: Search, o: Observations, group: np.ndarray,
    stated: dict[str, Stated],
) -> dict[str, ParameterGroup]:  # fmt: skip
    """Return values, intervals and verdicts of every group's parameters.

    values (groups, n); group (F,): of every frame of the recording, of which a task has some.
    """
    out = {}
    for number in range(task.groups):
        mine = torch.nonzero(task.group == number)[:, 0]
        part = task.frames(mine)
        part = replace(part, group=torch.zeros(len(mine), dtype=torch.int64))
        out[f"group_{number}"] = _described(
            part, values[number], search, number, o, group == number, stated
        )
    return out


def _described(
    task: Task, values: np.ndarray, search: Search, number: int, observations: Observations,
    member: np.ndarray, stated: dict[str, Stated],
) -> ParameterGroup:  # fmt: skip
    """Return the same of one group, whose frames are the task's. values (n,); member (F,) bool."""
    space = task.space
    floor = float(np.median(observations.noise))
    index = list(space.free)
    converged = bool(search.converged[number])
    estimates = cluster_estimates(
        uncertainty(task, values, floor, observations.length), space.free_names, values[index],
        (space.lower[index], space.upper[index]), converged,
    )  # fmt: skip
    with torch.no_grad():
        start = task.loss(space.to_search(space.start[None]), torch.zeros(1, dtype=torch.int64))
    fixed = {name: float(values[i]) for i, name in enumerate(space.names) if i not in space.free}
    rows = zip(space.start, space.lower, space.upper, strict=True)
    ranges = {name: Range(*row) for name, row in zip(space.names, rows, strict=True)}
    outcome = Outcome(
        float(start[0]), float(search.loss[number]), "m", search.evaluations, converged,
        bfgs.REASONS[int(search.status[number])],
    )  # fmt: skip
    return parameter_group(observations.frames[member], estimates, fixed, ranges, stated, outcome)
