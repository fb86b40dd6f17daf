"""identify on motion: rigidities and dampings of a rope that is stepped through time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.causes import with_causes
from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.motion_model import motion_model
from ropefit.adapters.motion_of import clips_of, times_of
from ropefit.adapters.motion_setup import SEGMENTS, Span, span_of
from ropefit.adapters.parameter_group import outcome_of_fit
from ropefit.adapters.priors import priors_of
from ropefit.adapters.rope_setup import STATIONS
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.fitting.choices import held_node
from ropefit.fitting.nominal import set_up_errors
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.inference.sandwich import BLOCK, block_estimates
from ropefit.models import parameters, rest_curve
from ropefit.models.dynamics import Dynamics, MotionPoint
from ropefit.models.grips import grips
from ropefit.models.parameters import IN_MOTION, offered
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from ropefit.runs.protocol import Context

SHORTEST = 20  # frames of a clip
OF_MOTION = 125  # frames of motion that count as one of --most-frames shapes
HORIZONS = (0.5, 1.5)  # s of each clip that are fitted before all of it
LEAST_MOTION = 0.01  # of the length: a rope that moves less shows neither inertia nor damping
LEAST_NOISE = 0.002  # m: what open-loop prediction of a real rope does not get below
# Of the length, rms, by segments: from a larger error on, the next finer mesh is used. It is
# extrapolated, so that about a quarter of it remains; the finest mesh takes four times as long.
MOST_MESH_ERROR: dict[int, float] = dict(zip(SEGMENTS, (1e-3, 3e-3), strict=False))
LOOK = 15  # evaluations of a first fit
CORRECTIONS = 3  # of the mesh's error, while the fit moves
UNMOVED = 0.3  # standard errors


def compute(o: Observations, settings: IdentifySettings, context: Context) -> FittedModel:
    """Return the nominal model. Raises BadInput, NotConverged, WrongUsage."""
    if not o.depth_measured:
        raise BadInput(
            "--solver dynamics needs markers, clouds or pictures with depth; "
            "use --solver equilibrium"
        )
    node, span = held_node(o, settings.control_at), span_of(o)
    clips = long_clips(o, span)
    if not all(np.isfinite(span.lines[c[:2]]).all() for c in clips):
        raise BadInput("the first two frames of a clip show too little of the rope to start from")
    _check_that_it_moves(span, clips)
    free = free_names(settings, o, span.setup)
    terms = terms_of(o, span, free)
    train, out = held_back(clips, len(o.frames), settings.holdout)
    train = train[: max(1, settings.most_frames * OF_MOTION // len(train[0]))]
    forward = _forward(o, span, terms, train)
    context.progress(0.1, "least squares")
    _check(forward.at(forward.start()), train)
    u, noise = _in_step(o, span, terms, train)
    context.progress(0.3, "least squares")
    problem = _within(span, noise, train)
    u = fit(forward, problem, u, settings.evaluations, tolerance=1e-4).point.u
    context.progress(0.7, "error of the mesh")
    forward = forward.corrected(u)
    for segments in SEGMENTS[1:]:
        if not finer_mesh_needed(forward, span.last - span.first):
            break
        span = span_of(o, segments)
        terms = terms_of(o, span, free)
        forward, problem = _forward(o, span, terms, train), _within(span, noise, train)
        u = fit(forward, problem, u, settings.evaluations, tolerance=1e-4).point.u
        forward = forward.corrected(u)
    found = self_corrected(forward, problem, u, settings.evaluations)
    estimates = block_estimates(found, train, times_of(o))
    u, trace = found.point.u, found.trace
    outcome = outcome_of_fit(trace, found.cost, found.evaluations, found.converged)
    del found  # its slopes, and the motion that they are of, are large
    context.progress(0.8, "all clips")
    whole = _forward(o, span, terms, clips)
    first = whole.at(whole.start()).seen
    point = whole.corrected(u).at(u)
    _check(point, clips)
    return motion_model(
        o, span, settings.loss, node, clips, out, outcome, trace, estimates, point, first,
        np.concatenate(train),
    )  # fmt: skip


def _in_step(
    o: Observations, span: Span, terms: list[Term], train: list[np.ndarray]
) -> tuple[np.ndarray, Noise]:
    """Return search variables (P,) to start from and the noise: a rope far off swings out of step,
    so it is fitted first as long as it is in step."""
    # What a motion misses wanders for a swing or so: of its many samples, few are news.
    noise, step = Noise(marker=LEAST_NOISE), float(np.median(np.diff(times_of(o))))
    u = _forward(o, span, terms, train).start()
    for seconds in HORIZONS:
        few = [c[: max(SHORTEST, round(seconds / step))] for c in train]
        short = _forward(o, span, terms, few)
        near = fit(short, _within(span, noise, few), u, LOOK, tolerance=1e-3)
        u = near.point.u
        rms = float(np.sqrt((near.stations.residual**2).mean()))
        noise = Noise(marker=max(noise.marker, rms * (BLOCK / step) ** 0.5))
    return u, noise


def self_corrected(forward: Dynamics, problem: FitProblem, u: np.ndarray, most: int) -> Fit:
    """Return the fit whose mesh error is estimated at its own parameters: an estimate at others is
    compensated by a wrong EI (deferred correction, repeated).

    forward: corrected at u (P,), search variables; most: evaluations of each fit. It stops when no
    variable moves by more than `UNMOVED`, or after `CORRECTIONS`.
    """
    found = fit(forward, problem, u, most, tolerance=1e-4)
    for _ in range(CORRECTIONS if forward.mesh_error is not None else 0):
        moved = np.abs(found.point.u - u) / np.maximum(found.sd(), 1e-12)
        if moved.max(initial=0.0) < UNMOVED:
            break
        u = found.point.u
        del found  # two fits at once are large
        found = fit(forward.corrected(u), problem, u, most, tolerance=1e-4)
    return found


def restored_motion(o: Observations, model: FittedModel) -> tuple[Span, MotionPoint]:
    """Return the motion of a recording as an identified rope makes it, of this recording or of
    another of the same rope in the same grips: each clip open loop from its first two frames."""
    span = identified_span(o, model)
    forward, u = model_of(o, model, span, long_clips(o, span))
    return span, forward.corrected(u).at(u)


def diagnosed_motion(
    o: Observations, model: FittedModel, found: Diagnosis
) -> tuple[Span, MotionPoint]:
    """Return `restored_motion` of the rope with the causes of a diagnosis, and with the values that
    were fitted along with them. Raises StageFailed for effects not installed."""
    span = identified_span(o, model)
    clips = long_clips(o, span)
    forward, _ = model_of(o, model, span, clips)
    setup, stated = span.setup, stated_units(o)
    for term in forward.terms:
        if term.nuisance:
            values = [found.calibration[calibration_name(term, axis)].value for axis in term.names]
        else:
            values = [found.rope[term.name].value / stated[term.name].factor]
        setup = term.apply(setup, np.array(values))
    known = _forward(o, replace(span, setup=with_causes(setup, found)), [], clips)
    return span, known.corrected(np.empty(0)).at(np.empty(0))


def identified_span(o: Observations, model: FittedModel) -> Span:
    """Return the rope between its grips with as many segments as it was identified with."""
    assert model.stepped is not None
    return span_of(o, model.stepped.segments)


def model_of(
    o: Observations, model: FittedModel, span: Span, clips: list[np.ndarray]
) -> tuple[Dynamics, np.ndarray]:
    """Return the model of some clips by what was free in a fit, and the search variables (P,) that
    the fit came to."""
    assert model.stepped is not None
    group = next(iter(model.groups.values()))
    terms, u = terms_of(o, span, group.free_names), []
    stated = stated_units(o)
    for term in terms:
        if term.nuisance:
            values = [model.stepped.calibration[f"{term.name}_{n}"].value for n in term.names]
        else:
            values = [group.parameters[term.name].value / stated[term.name].factor]
        u.append(term.search(np.array(values)))
    return _forward(o, span, terms, clips), np.concatenate(u)


def long_clips(o: Observations, span: Span) -> list[np.ndarray]:
    """Return indices of the frames of each clip, in all of which the grips are seen. Raises
    BadInput."""
    ends, clamp = span.setup.ends, span.setup.clamp
    driven = [ends[:, k] for k in range(2) if o.end_kind[k] != "free"]
    driven += [clamp[:, k] for k in range(2) if span.setup.clamped[k]]
    seen = np.all([np.isfinite(pose).all(1) for pose in driven], axis=0)
    parts = [
        part
        for clip in clips_of(times_of(o))
        for part in np.split(clip, np.flatnonzero(np.diff(seen[clip])) + 1)
    ]
    clips = [part for part in parts if seen[part[0]] and len(part) >= SHORTEST]
    if not clips:
        raise BadInput(
            f"no {SHORTEST} frames with both grips in sight follow each other without a gap in "
            "time; use --solver equilibrium for single shapes"
        )
    return clips


def held_back(
    clips: list[np.ndarray], frames: int, share: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the clips to fit, and which of all frames (F,) no fit sees: whole clips, or the last
    part of a single one, which is then predicted on from where the fit stops."""
    out = np.zeros(frames, dtype=bool)
    if len(clips) == 1:
        keep = len(clips[0]) - int(share * len(clips[0]))
        out[clips[0][keep:]] = True
        return [clips[0][:keep]], out
    count = min(round(share * len(clips)), len(clips) - 1)
    hidden = np.linspace(0, len(clips) - 1, count + 2)[1:-1].round().astype(int)
    for k in hidden:
        out[clips[k]] = True
    return [c for k, c in enumerate(clips) if k not in hidden], out


def free_names(settings: IdentifySettings, o: Observations, setup: Setup) -> list[str]:
    """Return the parameters that are fitted. Raises WrongUsage."""
    if settings.free is not None:
        asked = rest_curve.spelled_out(settings.free)
        for name in asked:
            if name not in IN_MOTION:
                raise WrongUsage(f"unknown parameter {name}; one of {offered(IN_MOTION)}")
        return sorted(set(asked), key=IN_MOTION.index)
    names = ["EI", "bend_damping", "air_damping"]
    if all(setup.clamped) and np.isfinite(setup.clamp_compliance).all():
        names.insert(1, "GJ")
    return names + (["length"] if o.length_source == "estimated" else [])


def terms_of(o: Observations, span: Span, free: list[str]) -> list[Term]:
    """Return the free parameters, then the errors of the grips, and those of a camera that sees the
    rope."""
    errors = grips(span.setup, priors_of(o).end_orientation, span.twist)
    if o.source != "markers":
        own = {term.name for term in errors}
        errors += [t for t in set_up_errors(span.setup, o, None) if t.name not in own]
    return parameters.terms(span.setup, free) + errors


def _forward(o: Observations, span: Span, terms: list[Term], clips: list[np.ndarray]) -> Dynamics:
    return Dynamics(
        span.setup, terms, time=times_of(o), clips=clips, observed=span.lines, every=span.every
    )


def _within(span: Span, noise: Noise, clips: list[np.ndarray]) -> FitProblem:
    """Return the data of some clips."""
    used = np.isin(np.arange(len(span.data.points)), np.concatenate(clips))
    return FitProblem(span.data, noise, STATIONS).without(~used)


def finer_mesh_needed(corrected: Dynamics, length: float) -> bool:
    """Return whether the mesh's error is too large to be extrapolated; length [m] of the rope."""
    if corrected.mesh_error is None:
        return False
    most = MOST_MESH_ERROR.get(corrected.base.segments, np.inf)
    return _rms(corrected.mesh_error[np.concatenate(corrected.clips)]) > most * length


def resolved_clips(corrected: Dynamics, length: float) -> list[np.ndarray]:
    """Return the clips whose mesh error is small enough to be extrapolated; all, if none is.

    In another the rope is thrown such that a finer mesh predicts another motion: nothing can be
    learnt from its misfit. length [m] of the rope.
    """
    if corrected.mesh_error is None:
        return corrected.clips
    most = max(MOST_MESH_ERROR.values()) * length
    return [c for c in corrected.clips if _rms(corrected.mesh_error[c]) <= most] or corrected.clips


def _rms(item: np.ndarray) -> float:
    return float(np.sqrt((item**2).mean()))


def _check_that_it_moves(span: Span, clips: list[np.ndarray]) -> None:
    """Raise BadInput where no clip shows a motion."""
    length = span.last - span.first
    moved = max(
        float(np.nanmax(np.linalg.norm(span.lines[c] - span.lines[c[0]], axis=-1), initial=0.0))
        for c in clips
    )
    if moved < LEAST_MOTION * length:
        raise BadInput(
            f"no point of the rope moves by more than {1e3 * moved:.2g} mm: there is no motion to "
            "fit; use --solver equilibrium"
        )


def _check(point: MotionPoint, clips: list[np.ndarray]) -> None:
    for clip, run in zip(clips, point.runs, strict=True):
        if not point.solution.converged[clip].all():
            raise NotConverged(
                f"the clip from frame {clip[0]} cannot be simulated: {run.trajectory.why()}"
            )
