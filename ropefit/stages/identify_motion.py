"""identify on motion: rigidities and dampings of a rope that is stepped through time."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ropefit.artifacts import FittedModel, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference.forward import Term
from ropefit.inference.least_squares import Noise, fit
from ropefit.inference.motion import MotionForward, MotionPoint, Run
from ropefit.inference.motion_spread import spread_of
from ropefit.inference.motion_terms import unknowns
from ropefit.inference.stations import Data
from ropefit.inference.terms import DEGREE, nuisance, rope_term, turn_clamp
from ropefit.rod.carried import carried
from ropefit.rod.moving import Damping
from ropefit.rod.setup import Setup
from ropefit.stages.identify_equilibrium import held_node, priors_of
from ropefit.stages.identify_settings import IdentifySettings
from ropefit.stages.motion_model import motion_model, told_units
from ropefit.stages.motion_of import centrelines, clips_of
from ropefit.stages.rope_setup import base_setup, data_in_space
from ropefit.stages.stage import Context

FINEST = 40  # segments, about: a clip of 500 frames takes some 0.1 s
SHORTEST = 20  # frames of a clip
ROUND_OFF = 100  # frames of motion that count as one of --most-frames shapes
PAIR = 6.0  # degrees: how far the line of two held markers may lie from the rope's own
LEAST_NOISE = 0.002  # m: what open-loop prediction of a real rope does not get below


def compute(o: Observations, settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """The contents of model.h5. Raises BadInput, NotConverged, WrongUsage."""
    if o.source != "markers":
        raise BadInput(
            "--solver dynamics needs markers: clouds show no motion along the rope; "
            "use --solver equilibrium"
        )
    node = held_node(o, settings.control_at)
    clips = [c for c in clips_of(o.time) if len(c) >= SHORTEST]
    if not clips:
        raise BadInput(
            f"no {SHORTEST} frames follow each other without a gap in time; "
            "use --solver equilibrium for single shapes"
        )
    setup, every, lines = motion_setup(o)
    if not all(np.isfinite(lines[c[:2]]).all() for c in clips):
        raise BadInput("the first two frames of a clip show too few markers to start from")
    data, known = data_in_space(o), unknowns(setup)
    free = _free_names(settings, o, setup)
    train, out = held_back(clips, len(o.frames), settings.holdout)
    train = train[: max(1, settings.most_frames * ROUND_OFF // len(train[0]))]
    terms = _terms(o, setup, free)
    forward = MotionForward(setup, terms, None, o.time, train, lines, every)
    used = np.isin(np.arange(len(o.frames)), np.concatenate(train))
    masked = Data(data.points, data.share, data.mask & used[:, None], data.material, data.eye)
    noise = Noise(marker=max(float(np.median(o.noise)), LEAST_NOISE))
    context.progress(0.1, "least squares")
    began = forward.at(forward.start())
    _check(began.solution.converged[used], began.runs)
    found = fit(forward, masked, noise, 1, forward.start(), settings.evaluations, tolerance=1e-5)
    context.progress(0.8, "all clips")
    whole = MotionForward(setup, terms, None, o.time, clips, lines, every)
    point, first = whole.at(found.point.u), whole.at(forward.start())
    every_clip = np.concatenate(clips)
    _check(point.solution.converged[every_clip], point.runs)
    spread = spread_of(found, train, o.time)
    return {
        "recording": o.recording,
        "length": o.length,
        "frames": o.frames,
        "models": {
            "nominal": motion_model(
                o, settings.loss, node, every, data, clips, out, found, spread, free, point, first,
                np.concatenate(train), known,
            )
        },
    }  # fmt: skip


def restored_motion(o: Observations, model: FittedModel) -> MotionPoint:
    """The motion of a recording as an identified rope makes it, of this recording or of another of
    the same rope in the same grips: each clip open loop from its first two frames."""
    assert model.stepped is not None
    setup, every, lines = motion_setup(o)
    group = next(iter(model.groups.values()))
    terms, u = _terms(o, setup, group.free_names), []
    factor = told_units(o, unknowns(setup))
    for term in terms:
        if term.nuisance:
            values = [model.stepped.calibration[f"{term.name}_{n}"].value for n in term.names]
        else:
            values = [group.parameters[term.name].value / factor[term.name]]
        u.append(term.search(np.array(values)))
    clips = [c for c in clips_of(o.time) if len(c) >= SHORTEST]
    forward = MotionForward(setup, terms, None, o.time, clips, lines, every)
    return forward.at(np.concatenate(u))


def motion_setup(o: Observations) -> tuple[Setup, int, np.ndarray]:
    """The nominal rope in motion; how many of its segments lie in one of the observations'; and
    the observed rope (F, K, 3) [m] at the observations' nodes.

    Clamps whose twist is not seen are carried along: they do not roll about the rope.
    """
    every = max(1, round(FINEST / (len(o.node_arc) - 1)))
    setup = base_setup(o, every * (len(o.node_arc) - 1))
    lines = centrelines(o, o.node_arc)
    zero = torch.zeros_like(setup.properties.length)
    setup = setup._replace(damping=Damping(zero, zero, zero, zero), motion=None)
    if not o.end_twist_known and all(setup.clamped):
        held = carried(setup.clamp.numpy(), lines, clips_of(o.time))
        setup = setup._replace(clamp=torch.from_numpy(held), give=torch.zeros_like(setup.give))
    return setup, every, lines


def held_back(
    clips: list[np.ndarray], frames: int, share: float
) -> tuple[list[np.ndarray], np.ndarray]:
    """The clips to fit, and which of all frames (F,) no fit sees: whole clips, or the last part of
    a single one, which is then predicted on from where the fit stops."""
    out = np.zeros(frames, dtype=bool)
    if share == 0:
        return clips, out
    count = round(share * len(clips)) if len(clips) > 1 else 0
    if count:
        hidden = np.linspace(0, len(clips) - 1, count + 2)[1:-1].round().astype(int)
        for k in hidden:
            out[clips[k]] = True
        return [c for k, c in enumerate(clips) if k not in hidden], out
    if len(clips) > 1:
        return clips, out
    keep = int((1 - share) * len(clips[0]))
    out[clips[0][keep:]] = True
    return [clips[0][:keep]], out


def _free_names(settings: IdentifySettings, o: Observations, setup: Setup) -> list[str]:
    names = ["EI", "bend_damping", "air_damping"]
    if all(setup.clamped) and bool(torch.isfinite(setup.give).all()):
        names.insert(1, "GJ")
    if o.length_source == "estimated":
        names.append("length")
    if settings.free is None:
        return names
    allowed = unknowns(setup)
    for name in settings.free:
        if name not in allowed:
            raise WrongUsage(f"unknown parameter {name}; one of {', '.join(allowed)}")
    return sorted(settings.free, key=list(allowed).index)


def _terms(o: Observations, setup: Setup, free: list[str]) -> list[Term]:
    """The free parameters, and how far clamps are turned from what the recording tells, the same in
    every frame."""
    known = unknowns(setup)
    rope = [
        rope_term(n, "", known[n].start, known[n].low, known[n].high, known[n].apply) for n in free
    ]
    prior = priors_of(o).end_orientation * DEGREE
    if not o.end_twist_known:
        prior = max(prior, PAIR * DEGREE)
    return rope + [
        nuisance(f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end), [prior] * 3)
        for end in range(2)
        if setup.clamped[end]
    ]


def _check(converged: np.ndarray, runs: list[Run]) -> None:
    if not converged.all():
        why = next(r.trajectory.why() for r in runs if not r.trajectory.converged[0])
        raise NotConverged(f"the motion cannot be simulated: {why}")
