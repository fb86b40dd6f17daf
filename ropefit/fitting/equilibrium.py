"""identify by least squares: rope parameters of the equilibrium model, with calibration errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ropefit.adapters.equilibrium_model import Part, describe_group, fitted_model
from ropefit.adapters.frames import calmest, group_frames, held_out, spread_evenly
from ropefit.adapters.priors import noise_of, priors_of
from ropefit.adapters.rope_setup import base_setup, data_in_space, segments_of
from ropefit.adapters.start_values import started_setup
from ropefit.artifacts import FittedModel, Observations
from ropefit.errors import NotConverged
from ropefit.fitting.branch import nearer_branch
from ropefit.fitting.choices import free_names, given_values, held_node
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise, estimate
from ropefit.inference.objective import MOST_LEFT
from ropefit.inference.problem import FitProblem
from ropefit.inference.profile import profile_intervals
from ropefit.inference.starts import best_start
from ropefit.models import parameters
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.priors import calibration
from ropefit.rod.setup import Setup
from ropefit.runs.protocol import Context, Progress
from ropefit.solvers.equilibrium.branches import follow

if TYPE_CHECKING:
    from ropefit.diagnosis.candidate import Candidate

SCREEN = (-4.0, -2.0, 0.0, 2.0, 4.0)  # logarithms of EI over the usual, from which a fit starts
LOOK = 12  # evaluations of the fit from each


def compute(o: Observations, settings: IdentifySettings, context: Context) -> FittedModel:
    """Return the nominal model. Raises BadInput, NotConverged, WrongUsage."""
    node = held_node(o, settings.control_at)
    if settings.law:
        from ropefit.fitting.free_law import law_named

        law_named(settings.law)  # before anything is computed
    setup = base_setup(o, segments_of(o))
    data = data_in_space(o)
    group = group_frames(o, settings.groups)
    out = held_out(len(group), settings.holdout)
    train = np.flatnonzero(~out)
    if settings.groups == "one":
        train = calmest(train, setup, settings.most_frames)
    train = spread_evenly(train, group, settings.most_frames)
    free = free_names(settings, o)
    started = started_setup(setup, given_values(o, settings, context), o)
    parts, groups, law = [], {}, None
    for number in range(int(group.max()) + 1):
        mine = np.flatnonzero(group == number)
        inside = np.isin(mine, train)
        part, law = _fit_group(
            started.frames(mine), data.frames(mine), inside, free, o, settings,
            _share_of(context, number, int(group.max()) + 1),
        )  # fmt: skip
        _warn_before_minimum(part[0], o.frames[mine[inside]], context.say)
        groups[f"group_{number}"] = describe_group(part, o.frames[mine], o)
        parts.append((mine, part))
    context.progress(0.9, "stability")
    model = fitted_model(o, settings.loss, node, started, data, parts, groups, out, train)
    if law:
        from ropefit.fitting.free_law import law_cause

        context.progress(0.95, "forms of the law")
        model = model.model_copy(update={"laws": {"law_0": law_cause(o, law)}})
    return model


def _warn_before_minimum(found: Fit, frames: np.ndarray, say: Callable[[str], None]) -> None:
    """Warn of a fit that ended where a linear step still promises much, and of the frames that may
    hold it there: the derivatives of one that is about to snap through grow without bound."""
    left = found.left_to_gain
    if left < MOST_LEFT:
        return
    from ropefit.diagnosis.noise_measurement import on_edge

    edge = frames[on_edge(found)]
    held = f", held by frames at the edge of stability: {', '.join(map(str, edge))}"
    say(
        f"warning: the fit ended before its minimum (a linear step promises {left:.2g} of χ²)"
        f"{held if len(edge) else ''}; intervals may be too narrow"
    )


def _share_of(context: Context, number: int, groups: int) -> Progress:
    """Return the progress of one group's fit as the stage's, from 5 to 85 %."""

    def progress(share: float, text: str) -> None:
        context.progress(0.05 + 0.8 * (number + share) / groups, text)

    return progress


def nominal_fit(
    setup: Setup,
    data: Data,
    free: list[str],
    o: Observations,
    evaluations: int,
    progress: Progress = lambda share, text: None,
) -> Fit:
    """Fit the free parameters and the calibration errors, noise estimated on the way.

    Raises NotConverged when no start settles.
    """
    problem = FitProblem(data, noise_of(o, data), len(o.node_arc) - 1)
    terms = parameters.terms(setup, sorted(free))
    forward = Equilibrium(setup, terms)
    start, rigidity = forward.start(), np.array([t.name == "EI" for t in terms])
    screened = SCREEN if rigidity.any() else (0.0,)

    def starts() -> Iterator[np.ndarray]:
        for count, shift in enumerate(screened):
            progress(0.5 * count / len(screened), "where to start")
            yield start + shift * rigidity

    def trial(start: np.ndarray) -> Fit:
        states = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
        return fit(forward.starting_from(states), problem, start, LOOK if start.size else 1)

    try:
        best = best_start(starts(), trial)
    except ArithmeticError:
        raise NotConverged(
            "no frame reaches an equilibrium; look at the ends and the length"
        ) from None
    last = nearer_branch(best)
    progress(0.5, "least squares")
    # What the rope misses must not be forced on the errors of the set-up.
    loose = max(1.0, best.scale) if data.material else 1.0
    full = Equilibrium(setup, [*terms, *calibration(setup, priors_of(o), o.ends_assumed)], last)
    return calibrated_fit(full, best.point.u, problem, evaluations, loose)


def calibrated_fit(
    full: Equilibrium,
    rope: np.ndarray,
    problem: FitProblem,
    evaluations: int,
    loose: float,
) -> Fit:
    """Fit rope and calibration together, from search variables `rope` of the first terms; measure
    what is left of noise, and fit once more under it. loose: how many times the markers' noise the
    rope alone misses; the errors of the set-up may take their share of that."""
    start = full.start()
    start[: rope.size] = rope
    own = problem.noise.marker
    first = fit(full, problem.under(replace(problem.noise, marker=loose * own)), start, evaluations)
    missed = max(1.0, loose * first.scale) if loose > 1 else 1.0
    noise = estimate(first.stations, Noise(marker=missed * own, sensor=own))
    return fit(full, problem.under(noise), first.point.u, evaluations)


def _fit_group(
    setup: Setup,
    data: Data,
    inside: np.ndarray,
    free: list[str],
    o: Observations,
    settings: IdentifySettings,
    progress: Progress,
) -> tuple[Part, Candidate | None]:
    """Fit on the training frames (mask `inside`), then settle all of the group's frames; the law,
    if one is asked for."""
    few, seen = setup.frames(inside), data.frames(inside)
    found, law = nominal_fit(few, seen, free, o, settings.evaluations, progress), None
    if settings.law:
        from ropefit.fitting.free_law import law_named, with_law

        progress(0.7, "law")
        law = with_law(found, law_named(settings.law))
        found = law.fit
    progress(0.9, "intervals")
    estimates = profile_intervals(found)
    whole = Equilibrium(setup, found.forward.terms)
    start = follow(whole.setup_at(found.point.u).rod(), whole.conditions_at(found.point.u)).states
    start.put(inside, found.point.solution)
    return (found, whole.at(found.point.u, start), estimates), law
