"""identify on motion: rigidities and dampings of a rope that is stepped through time."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ropefit.artifacts import FittedModel, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference import rest_curve
from ropefit.inference.forward import Term
from ropefit.inference.least_squares import Noise, data_without, fit
from ropefit.inference.motion import MotionForward, MotionPoint
from ropefit.inference.motion_spread import BLOCK, spread_of
from ropefit.inference.motion_terms import grips, unknowns
from ropefit.inference.stations import Data
from ropefit.rod.setup import Setup
from ropefit.stages.identify_equilibrium import held_node, priors_of
from ropefit.stages.identify_settings import IdentifySettings
from ropefit.stages.motion_model import motion_model, told_units
from ropefit.stages.motion_of import clips_of
from ropefit.stages.motion_setup import EVERY, Span, span_of
from ropefit.stages.stage import Context

SHORTEST = 20  # frames of a clip
OF_MOTION = 100  # frames of motion that count as one of --most-frames shapes
HORIZONS = (0.5, 1.5)  # s of each clip that are fitted before all of it
LEAST_NOISE = 0.002  # m: what open-loop prediction of a real rope does not get below
LOOK = 15  # evaluations of a first fit


def compute(o: Observations, settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """The contents of model.h5. Raises BadInput, NotConverged, WrongUsage."""
    if o.source != "markers":
        raise BadInput(
            "--solver dynamics needs markers: clouds show no motion along the rope; "
            "use --solver equilibrium"
        )
    node, clips = held_node(o, settings.control_at), long_clips(o)
    span = span_of(o)
    if not all(np.isfinite(span.lines[c[:2]]).all() for c in clips):
        raise BadInput("the first two frames of a clip show too few markers to start from")
    free = free_names(settings, o, span.setup)
    terms = terms_of(o, span.setup, free)
    train, out = held_back(clips, len(o.frames), settings.holdout)
    train = train[: max(1, settings.most_frames * OF_MOTION // len(train[0]))]
    forward = _forward(o, span, terms, train)
    seen = _within(span.data, train)
    # What a motion misses wanders for a swing or so: of its many samples, few are news.
    noise, step = Noise(marker=LEAST_NOISE), float(np.median(np.diff(o.time)))
    context.progress(0.1, "least squares")
    _check(forward.at(forward.start()), train)
    start = forward.start()
    for seconds in HORIZONS:  # a rope far off swings out of step: first, as long as it is in step
        few = [c[: max(SHORTEST, round(seconds / step))] for c in train]
        short = _forward(o, span, terms, few)
        near = fit(short, _within(span.data, few), noise, 1, start, LOOK, tolerance=1e-3)
        start = near.point.u
        rms = float(np.sqrt((near.stations.residual**2).mean()))
        noise = Noise(marker=max(noise.marker, rms * (BLOCK / step) ** 0.5))
    context.progress(0.3, "least squares")
    found = fit(forward, seen, noise, 1, start, settings.evaluations, tolerance=1e-4)
    context.progress(0.8, "all clips")
    whole = _forward(o, span, terms, clips)
    point, first = whole.at(found.point.u), whole.at(forward.start())
    _check(point, clips)
    spread = spread_of(found, train, o.time)
    model = motion_model(
        o, span, settings.loss, node, clips, out, found, spread, free, point, first,
        np.concatenate(train),
    )  # fmt: skip
    if not out.any():
        context.say("no frame held out: the fit is judged on its own frames")
    return {
        "recording": o.recording,
        "length": o.length,
        "frames": o.frames,
        "models": {"nominal": model},
    }


def restored_motion(o: Observations, model: FittedModel) -> tuple[Span, MotionPoint]:
    """The motion of a recording as an identified rope makes it, of this recording or of another of
    the same rope in the same grips: each clip open loop from its first two frames."""
    assert model.stepped is not None
    span = span_of(o)
    group = next(iter(model.groups.values()))
    terms, u = terms_of(o, span.setup, group.free_names), []
    factor = told_units(o, span.setup)
    for term in terms:
        if term.nuisance:
            values = [model.stepped.calibration[f"{term.name}_{n}"].value for n in term.names]
        else:
            values = [group.parameters[term.name].value / factor[term.name]]
        u.append(term.search(np.array(values)))
    return span, _forward(o, span, terms, long_clips(o)).at(np.concatenate(u))


def long_clips(o: Observations) -> list[np.ndarray]:
    """Indices of the frames of each clip. Raises BadInput."""
    clips = [c for c in clips_of(o.time) if len(c) >= SHORTEST]
    if not clips:
        raise BadInput(
            f"no {SHORTEST} frames follow each other without a gap in time; "
            "use --solver equilibrium for single shapes"
        )
    return clips


def held_back(
    clips: list[np.ndarray], frames: int, share: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """The clips to fit, and which of all frames (F,) no fit sees: whole clips, or the last part of
    a single one, which is then predicted on from where the fit stops."""
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
    """The parameters that are fitted. Raises WrongUsage."""
    allowed = unknowns(setup)
    if settings.free is not None:
        asked = rest_curve.spelled_out(settings.free)
        for name in asked:
            if name not in allowed:
                known = [n for n in allowed if n not in rest_curve.VARYING]
                raise WrongUsage(
                    f"unknown parameter {name}; one of {', '.join([*known, rest_curve.SHORT])}"
                )
        return sorted(set(asked), key=list(allowed).index)
    names = ["EI", "bend_damping", "air_damping"]
    if all(setup.clamped) and bool(torch.isfinite(setup.clamp_compliance).all()):
        names.insert(1, "GJ")
    return names + (["length"] if o.length_source == "estimated" else [])


def terms_of(o: Observations, setup: Setup, free: list[str]) -> list[Term]:
    """The free parameters, then the errors of the grips."""
    known = unknowns(setup)
    own = [known[name].term(name, setup) for name in free]
    return own + grips(setup, priors_of(o).end_orientation)


def _forward(
    o: Observations, span: Span, terms: list[Term], clips: list[np.ndarray]
) -> MotionForward:
    return MotionForward(
        span.setup, terms, time=o.time, clips=clips, observed=span.lines, every=EVERY
    )


def _within(data: Data, clips: list[np.ndarray]) -> Data:
    """The data of some clips."""
    used = np.isin(np.arange(len(data.points)), np.concatenate(clips))
    return data_without(data, ~used)


def _check(point: MotionPoint, clips: list[np.ndarray]) -> None:
    for clip, run in zip(clips, point.runs, strict=True):
        if not point.solution.converged[clip].all():
            raise NotConverged(
                f"the clip from frame {clip[0]} cannot be simulated: {run.trajectory.why()}"
            )
