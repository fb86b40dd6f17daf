"""The nominal model of a diagnosis in motion: the stepped rope as identified, and its grips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.motion_setup import Span, span_of
from ropefit.adapters.priors import noise_of
from ropefit.adapters.rope_setup import STATIONS
from ropefit.artifacts import FittedModel, Observations
from ropefit.errors import NotConverged
from ropefit.fitting.motion import LEAST_NOISE, OF_MOTION, long_clips, model_of
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem

SAMPLE = 0.04  # s between compared frames: a rope swings slower
EVALUATIONS = 8
BEGIN = 9  # frames whose parabola gives a clip's first two: noise there is a wrong first speed


def nominal_in_motion(o: Observations, model: FittedModel, most_frames: int) -> tuple[Span, Fit]:
    """Fit the nominal model to as many clips as `most_frames` shapes stand for. Raises BadInput,
    NotConverged."""
    clips, span = long_clips(o), span_of(o)
    most = max(1, most_frames * OF_MOTION // max(len(c) for c in clips))
    spread = np.linspace(0, len(clips) - 1, min(most, len(clips))).round().astype(int)
    clips = [clips[k] for k in spread]
    span = replace(span, lines=_begun_smoothly(o.time, span.lines, clips))
    forward, start = model_of(o, model, span, clips)
    step = float(np.median(np.diff(o.time[clips[0]])))
    compared = np.zeros(len(o.frames), dtype=bool)
    for clip in clips:
        compared[clip[:: max(1, round(SAMPLE / step))]] = True
    problem = FitProblem(
        span.data, Noise(marker=LEAST_NOISE, sensor=noise_of(o, span.data).marker), STATIONS
    ).without(~compared)
    found = fit(forward, problem, start, EVALUATIONS, tolerance=1e-4)
    if not found.point.converged.all():
        raise NotConverged("a clip cannot be simulated to its end; identify it with other clips")
    return span, found


def _begun_smoothly(time: np.ndarray, lines: np.ndarray, clips: list[np.ndarray]) -> np.ndarray:
    """Return centrelines (F, K, 3) [m] with the first two of each clip from a parabola in time."""
    out = lines.copy()
    for clip in clips:
        near = clip[:BEGIN]
        if np.isfinite(lines[near]).all():
            powers = np.vander(time[near] - time[near[0]], 3)
            weights = powers[:2] @ np.linalg.pinv(powers)
            out[near[:2]] = np.einsum("bt,tka->bka", weights, lines[near])
    return out
