"""identify on motion: rigidities and dampings of a rope that is stepped through time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ropefit.artifacts import Calibration, FittedModel, Observations, ParameterGroup, Stepped
from ropefit.artifacts.model import Parameter
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference.evaluate import agreement
from ropefit.inference.forward import Term
from ropefit.inference.least_squares import Fit, Noise, fit
from ropefit.inference.motion import MotionForward
from ropefit.inference.motion_spread import Spread, spread_of
from ropefit.inference.stations import Data, match, offsets
from ropefit.inference.terms import (
    DEGREE,
    Apply,
    nuisance,
    rope_term,
    set_bend,
    set_length,
    set_twist,
    turn_clamp,
)
from ropefit.rod.carried import carried
from ropefit.rod.moving import Damping
from ropefit.rod.setup import Setup
from ropefit.stages.identify_equilibrium import held_node, priors_of
from ropefit.stages.identify_settings import IdentifySettings
from ropefit.stages.motion_of import centrelines, clips_of
from ropefit.stages.rope_setup import base_setup, data_in_space
from ropefit.stages.scene import build_scene
from ropefit.stages.stage import Context

FINEST = 40  # segments, about: a clip of 500 frames takes some 0.1 s
SHORTEST = 20  # frames of a clip
ROUND_OFF = 100  # frames of motion that count as one of --most-frames shapes
PAIR = 6.0  # degrees: how far the line of two held markers may lie from the rope's own
LEAST_NOISE = 0.002  # m: what open-loop prediction of a real rope does not get below


@dataclass(frozen=True)
class Unknown:
    """A parameter: its meaning, unit without and with the mass known, start and bounds in
    multiples of `size`, how it acts."""

    meaning: str
    unit: str
    ratio: str
    start: float
    low: float
    high: float
    apply: Apply


def _air(setup: Setup, v: Tensor) -> Setup:
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(air=same))


def _bend_damping(setup: Setup, v: Tensor) -> Setup:
    assert setup.damping is not None
    same = v[0].expand(setup.properties.length.shape)
    return setup._replace(damping=setup.damping._replace(bend=same, twist=same))


def unknowns(setup: Setup) -> dict[str, Unknown]:
    """What may be fitted, in the units of the setup (a rope of known weight, or of 1 kg/m)."""
    p = setup.properties
    length, density = float(p.length.sum()), float(p.density.mean())
    heavy = density * 9.81
    bend, time = heavy * length**3, (length / 9.81) ** 0.5
    return {
        "EI": Unknown(
            "bending rigidity", "N m^2", "m^3", 1e-3 * bend, 1e-6 * bend, 1.0 * bend, set_bend
        ),
        "GJ": Unknown(
            "twist rigidity", "N m^2", "m^3", 1e-3 * bend, 1e-6 * bend, 1.0 * bend, set_twist
        ),
        "bend_damping": Unknown(
            "bending moment per rate of curvature", "N m^2 s", "m^3 s",
            1e-4 * bend * time, 1e-8 * bend * time, 0.1 * bend * time, _bend_damping,
        ),
        "air_damping": Unknown(
            "force per length and speed", "N s/m^2", "s/m",
            0.05 * heavy * time / length, 1e-4 * heavy * time / length,
            10 * heavy * time / length, _air,
        ),
        "length": Unknown("rest length", "m", "m", length, 0.8 * length, 1.2 * length, set_length),
    }  # fmt: skip


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
    terms = [rope_term(n, "", known[n].start, known[n].low, known[n].high, known[n].apply)
             for n in free]  # fmt: skip
    terms += _calibration(o, setup)
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
            "nominal": _model(
                o, settings, node, every, data, clips, out, found, spread, free, point, first,
                np.concatenate(train), known, lines,
            )
        },
    }  # fmt: skip


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


def _calibration(o: Observations, setup: Setup) -> list[Term]:
    """How far clamps are turned from what the recording tells, the same in every frame."""
    prior = priors_of(o).end_orientation * DEGREE
    if not o.end_twist_known:
        prior = max(prior, PAIR * DEGREE)
    return [
        nuisance(f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end), [prior] * 3)
        for end in range(2)
        if setup.clamped[end]
    ]


def _check(converged: np.ndarray, runs: list) -> None:
    if not converged.all():
        why = next(r.trajectory.why() for r in runs if not r.trajectory.converged[0])
        raise NotConverged(f"the motion cannot be simulated: {why}")


def _model(
    o: Observations, settings: IdentifySettings, node: int, every: int, data: Data,
    clips: list[np.ndarray], out: np.ndarray, found: Fit, spread: Spread, free: list[str], point,
    first, train: np.ndarray, known: dict[str, Unknown], lines: np.ndarray,
) -> FittedModel:  # fmt: skip
    nodes, weight = len(o.node_arc), float(np.linalg.norm(o.gravity))
    clip = np.full(len(o.frames), -1)
    for number, frames in enumerate(clips):
        clip[frames] = number
    reached = clip >= 0
    # Frames of no clip are not simulated: they stay as observed, and are marked.
    x, before = (
        np.where(reached[:, None, None], p.seen[:, ::every], np.nan_to_num(lines))
        for p in (point, first)
    )
    q = np.zeros((len(o.frames), nodes - 1, 4))
    q[..., 0] = 1.0
    q[reached] = point.solution.q[reached][:, every // 2 :: every]
    rms, rms_first = (_rms(data, np.nan_to_num(p.seen), reached) for p in (point, first))
    factor = {n: 1.0 if o.mass or n == "length" else 1 / weight for n in known}
    parameters = {
        name: Parameter(
            meaning=known[name].meaning + ("" if o.mass or name == "length" else
                                           " over the weight per length"),
            unit=known[name].unit if o.mass else known[name].ratio,
            initial=known[name].start * factor[name],
            value=spread.value[name] * factor[name],
            lower=known[name].low * factor[name],
            upper=known[name].high * factor[name],
            free=True,
            verdict=spread.verdict[name],  # type: ignore[arg-type]
            ci95=(spread.low[name] * factor[name], spread.high[name] * factor[name]),
            trades_with=spread.partners[name],
        )
        for name in free
    }  # fmt: skip
    calibration, place = {}, 0
    for term in found.forward.terms:
        for k, axis in enumerate(term.names if term.nuisance else ()):
            calibration[f"{term.name}_{axis}"] = Calibration(
                unit=term.units[k], prior=float(term.prior[k]),
                value=float(found.point.u[place + k] * term.scale[k]),
                sd=float(spread.sd[place + k] * term.scale[k]),
            )  # fmt: skip
        place += term.size
    count = len(free)
    p = point.setup.properties
    return FittedModel(
        solver="dynamics",
        loss=settings.loss,
        search="least-squares",
        control_node=node,
        fixed_nodes=[n for n, k in zip((0, nodes - 1), o.end_kind, strict=True) if k != "free"],
        two_sided=False,
        groups={
            "group_0": ParameterGroup(
                frames=o.frames, parameters=parameters, free_names=free,
                correlation=spread.correlation[:count, :count], condition=spread.condition,
                loss_before=found.trace[0], loss_after=found.cost, loss_unit="chi-square",
                evaluations=found.evaluations, converged=found.converged,
                stop_reason="residual no longer decreases" if found.converged
                else "evaluation limit",
            )
        },
        heldout=out & reached,
        x=x,
        q=q,
        x_initial=np.nan_to_num(before),
        residual=_at_nodes(data, np.nan_to_num(point.seen), nodes - 1),
        rms=rms,
        rms_initial=rms_first,
        rms_px=agreement(torch.from_numpy(x), build_scene(o)).rms_px,
        solver_converged=True,
        stepped=Stepped(
            segments=point.setup.segments, clips=len(clips), clip=clip,
            newton=point.solution.iterations, mass_known=bool(o.mass),
            bending_length=float((p.bend.mean() / (p.density.mean() * weight)) ** (1 / 3)),
            calibration=calibration,
        ),
        trace=np.array(found.trace),
        rms_fit=float(np.sqrt(np.mean(rms[train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(rms[out & reached] ** 2))) if out.any() else None,
    )  # fmt: skip


def _rms(data: Data, x: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """(F,) [m] distance of the markers from where they were simulated; 0 where they were not."""
    gap, mask = offsets(data, x)
    square = np.where(mask, (gap**2).sum(-1), 0.0).sum(1)
    return np.where(reached, np.sqrt(square / np.maximum(mask.sum(1), 1)), 0.0)


def _at_nodes(data: Data, x: np.ndarray, bins: int) -> np.ndarray:
    """(F, bins + 1) [m] mean distance of the markers nearest to each node, NaN where none is."""
    s = match(data, x, bins)
    node = np.rint(s.share * bins).astype(int)
    total, count = np.zeros((len(x), bins + 1)), np.zeros((len(x), bins + 1))
    np.add.at(total, (s.frame, node), np.linalg.norm(s.residual, axis=1))
    np.add.at(count, (s.frame, node), 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
