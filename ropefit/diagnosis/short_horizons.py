"""Candidates of a motion by short horizons: predicted anew every so often from what was observed.

An open-loop prediction that has come out of step with the rope hardly shows why: its derivatives
are those of another motion. Over a short horizon it stays in step, and what it misses (innovations)
is nearly linear in what is missing. Fits to whole clips start from what short horizons say, and
their horizon grows (multiple shooting towards single shooting; Ribeiro et al., On the smoothness of
nonlinear system identification, Automatica 121, 2020).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ropefit.diagnosis.acceptance import agreeing
from ropefit.diagnosis.candidate import EVALUATIONS, Candidate, compared, fit_candidate
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.innovations import SHORT, over_horizons
from ropefit.diagnosis.scan import Projection, Score, Scorer
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.diagnosis.wander import wandering_noise
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.problem import FitProblem
from ropefit.models.model import Model

LONGER = (1.2,)  # s: horizons between the short one and whole clips
MOST_LEADERS = 3
PROMISING = 0.0  # nats to first order: what is far off gains more than that when it is fitted
MOST_WHOLE = 2  # candidates that are fitted to whole clips
LOOK = 8  # evaluations of a fit over horizons


def by_short_horizons(
    current: Fit, every: Iterable[Hypothesis], threshold: float
) -> list[Candidate]:
    """Return the candidates that short horizons support, as fitted to whole clips.

    every: the hypotheses that are scanned; threshold [nats]: least evidence over short horizons.
    """
    near = _over(SHORT, current.forward, current.problem, current.point.u)
    if near is None:
        return []
    noise = wandering_noise(near, [])
    near = _over(SHORT, current.forward, current.problem.under(noise), near.point.u)
    if near is None:
        return []
    needed = near.cost - 2 * threshold
    supported = [
        candidate
        for score in _leaders(near, every)
        if score.log_factor > PROMISING
        for start in [np.concatenate(score.starts()[0])]
        for candidate in [fit_candidate(near, score.hypothesis, start, needed=needed)]
        if candidate and candidate.evidence > threshold and agreeing(candidate.gains)
    ]
    supported.sort(key=lambda candidate: -candidate.evidence)
    whole = [_over_whole_clips(current, candidate) for candidate in supported[:MOST_WHOLE]]
    return [candidate for candidate in whole if candidate]


def _leaders(near: Fit, every: Iterable[Hypothesis]) -> list[Score]:
    """Return the highest scores over short horizons."""
    sensitivities, project = Sensitivities(near), Projection(near)
    scores = [
        Scorer(sensitivities.of(h), project, h.scales(near.point.setup))(project.z) for h in every
    ]
    return sorted(scores, key=lambda s: -s.log_factor)[:MOST_LEADERS]


def _over_whole_clips(current: Fit, near: Candidate) -> Candidate | None:
    """Return a candidate over short horizons as fitted to whole clips, beside the current model."""
    forward = current.forward.with_terms(near.fit.forward.terms)
    begin = near.fit.point.u
    for seconds in LONGER:
        longer = _over(seconds, forward, current.problem, begin)
        begin = longer.point.u if longer else begin
    fitted = attempted(forward, current.problem, begin, EVALUATIONS, tolerance=1e-5)
    if fitted is None or len(fitted.z) != len(current.z) or not fitted.point.converged.all():
        return None
    return compared(near.hypothesis, near.term, current, fitted)


def _over(seconds: float, forward: Model, problem: FitProblem, start: np.ndarray) -> Fit | None:
    """Return a fit over horizons, from search variables (P,)."""
    return attempted(*over_horizons(seconds, forward, problem), start, LOOK, tolerance=1e-3)
