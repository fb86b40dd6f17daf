"""The nominal model of a diagnosis in motion: the stepped rope as identified, and its grips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ropefit.adapters.frozen import frozen_values
from ropefit.adapters.motion_of import times_of
from ropefit.adapters.motion_setup import Span
from ropefit.adapters.priors import noise_of
from ropefit.adapters.rope_setup import STATIONS
from ropefit.adapters.taken_over import TakenOver, held_alike, of_rope
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.errors import NotConverged
from ropefit.fitting.motion import (
    LEAST_NOISE,
    OF_MOTION,
    identified_span,
    long_clips,
    model_of,
    resolved_clips,
    self_corrected,
)
from ropefit.fitting.nominal import as_known, calibrated, set_up_errors
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.dynamics import Dynamics
from ropefit.models.first_state import begun_smoothly
from ropefit.models.parameters import IN_MOTION, PARAMETERS

SAMPLE = 0.04  # s between compared frames: a rope swings slower
EVALUATIONS = 8
UNRESOLVED = "as a finer mesh moves otherwise"
SPARE = 2  # times as many clips as are fitted are looked at


def nominal_in_motion(
    o: Observations, model: Model, most_frames: int, known: Model | None, found: Diagnosis | None,
    calibration: Model | None, say: Callable[[str], None],
) -> tuple[Span, Fit, list[TakenOver], np.ndarray]:  # fmt: skip
    """Fit the nominal model to as many clips as `most_frames` shapes stand for; with what it takes
    over from another run, and the indices of the frames in clips that are excluded.

    known: that run's model, whose rope is known, and found: its diagnosis; calibration: a model
    whose camera and gravity are known; say: tells which clips are excluded. Raises BadInput,
    NotConverged, WrongUsage.
    """
    span = identified_span(o, model.nominal)
    clips = long_clips(o, span)
    most = max(1, most_frames * OF_MOTION // max(len(c) for c in clips))
    clips = _spread(clips, SPARE * most)
    span = replace(span, lines=begun_smoothly(times_of(o), span.lines, clips, clips))
    forward, start = model_of(o, model.nominal, span, clips)
    forward = forward.corrected(start)
    resolved = resolved_clips(forward, span.last - span.first)
    kept = {clip[0] for clip in resolved}
    lost = [clip for clip in clips if clip[0] not in kept]
    if lost:
        starts = ", ".join(str(o.frames[clip[0]]) for clip in lost)
        say(f"excluded, {UNRESOLVED}: clips from frames {starts}")
    clips = _spread(resolved, most)
    forward = replace(forward, clips=clips)
    taken: list[TakenOver] = []
    if known:
        forward, start = _known_rope(o, forward, start, known)
        forward, start = _known_pairs(o, span, forward, start, known, found)
        taken = of_rope(known, found, o, span.setup) if found else []
        begin = [np.zeros(term.size) for _, _, term in taken]
        forward = forward.with_terms([*(term for _, _, term in taken), *forward.terms])
        start = np.concatenate([*begin, start])
    if calibration:
        errors = set_up_errors(span.setup, o, None)
        loosened = {new.name: new for old, new in zip(errors, calibrated(errors, calibration),
                    strict=True) if new is not old}  # fmt: skip
        # Of a camera that sees the rope they are in the model already.
        old = list(zip(forward.terms, forward.split(start), strict=True))
        old = [(t, u) for t, u in old if t.name not in loosened]
        forward = forward.with_terms([*(t for t, _ in old), *loosened.values()])
        begin = [*(u for _, u in old), *(np.zeros(t.size) for t in loosened.values())]
        start = np.concatenate(begin)
    step = float(np.median(np.diff(times_of(o)[clips[0]])))
    compared = np.zeros(len(o.frames), dtype=bool)
    for clip in clips:
        compared[clip[:: max(1, round(SAMPLE / step))]] = True
    problem = FitProblem(
        span.data, Noise(marker=LEAST_NOISE, sensor=noise_of(o, span.data).marker), STATIONS
    ).without(~compared)
    forward = forward.corrected(start) if known or calibration else forward
    fitted = self_corrected(forward, problem, start, EVALUATIONS)
    if not fitted.point.converged.all():
        raise NotConverged("a clip cannot be simulated to its end; identify it with other clips")
    return span, fitted, taken, np.concatenate([np.empty(0, dtype=int), *lost])


def _spread(clips: list[np.ndarray], most: int) -> list[np.ndarray]:
    """Return at most so many clips, evenly spread."""
    few = np.linspace(0, len(clips) - 1, min(most, len(clips)))
    return [clips[k] for k in few.round().astype(int)]


def _known_rope(
    o: Observations, forward: Dynamics, start: np.ndarray, known: Model
) -> tuple[Dynamics, np.ndarray]:
    """Return the model with the rope of another run, within that run's intervals, and the search
    variables (P,) that it starts from; what that run does not tell starts where it was fitted."""
    values, stated = frozen_values(known, "--nominal", o), stated_units(o)
    (group,) = known.nominal.groups.values()
    values = {n: v for n, v in values.items() if n != "length" and group.parameters[n].free}
    own = dict(zip((t.name for t in forward.terms), forward.split(start), strict=True))
    terms, begin = [], []
    rope = {t.name: t for t in forward.terms if not t.nuisance}
    for name in (n for n in IN_MOTION if n in rope or n in values):
        term = rope.get(name)
        if name in values:
            fitted = PARAMETERS[name].term(forward.base, values[name] / stated[name].factor)
            term = as_known(fitted, group.parameters[name])
        terms.append(term)
        begin.append(np.zeros(1) if name in values else own[name])
    errors = [t for t in forward.terms if t.nuisance]
    begin += [own[t.name] for t in errors]
    return forward.with_terms([*terms, *errors]), np.concatenate(begin)


def _known_pairs(
    o: Observations, span: Span, forward: Dynamics, start: np.ndarray, known: Model,
    found: Diagnosis | None,
) -> tuple[Dynamics, np.ndarray]:  # fmt: skip
    """Return the model with the lines of held pairs of markers as another run knows them, and the
    search variables (P,) that it starts from."""
    terms, begin = [], []
    pairs = [end for end, pair in enumerate((span.first > 0, span.last < o.length)) if pair]
    for term, u in zip(forward.terms, forward.split(start), strict=True):
        own = term
        for end in pairs:
            own = held_alike(own, end, known, found)
        terms.append(own)
        begin.append(u if own is term else own.search(own.start))
    return forward.with_terms(terms), np.concatenate(begin)
