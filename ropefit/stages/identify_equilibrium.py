"""identify by least squares: rope parameters of the equilibrium model, with calibration errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ropefit.artifacts import Observations
from ropefit.errors import NotConverged, WrongUsage
from ropefit.inference import rest_curve
from ropefit.inference.equilibrium_rope import NAMES, ranges
from ropefit.inference.forward import Forward, Term
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.limits import limits
from ropefit.inference.noise import Noise, estimate
from ropefit.inference.stations import Data, match
from ropefit.inference.terms import PAIR, ROPE, Priors, calibration, rope_term
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.branches import follow, other_states
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.stages.equilibrium_model import Part, describe_group, fitted_model
from ropefit.stages.frames import group_frames, held_out, spread_evenly
from ropefit.stages.frozen import frozen_values
from ropefit.stages.identify_settings import IdentifySettings
from ropefit.stages.rope_setup import base_setup, data_in_space, segments_of
from ropefit.stages.scene import node_at
from ropefit.stages.stage import Context, Progress

CALM = 0.05  # of the frames of a rope in motion
LIVELY = 0.05  # of gravity: where a rope accelerates less, any frame is calm
SCREEN = (-4.0, -2.0, 0.0, 2.0, 4.0)  # logarithms of EI over the usual, from which a fit starts


def compute(o: Observations, settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """The contents of model.h5. Raises BadInput, NotConverged, WrongUsage."""
    node = held_node(o, settings.control_at)
    setup = base_setup(o, segments_of(o))
    data, scale = data_in_space(o), unit_scale(o)
    group = group_frames(o, settings.groups)
    out = held_out(len(group), settings.holdout)
    train = np.flatnonzero(~out)
    if settings.groups == "one":
        train = calmest(train, setup, settings.most_frames)
    train = spread_evenly(train, group, settings.most_frames)
    free = free_names(settings, o)
    started = started_setup(setup, given_values(o, settings, context), scale)
    parts, groups = [], {}
    for number in range(int(group.max()) + 1):
        mine = np.flatnonzero(group == number)
        inside = np.isin(mine, train)
        part = _fit_group(
            started.frames(torch.from_numpy(mine)), data.frames(mine), inside, free, o, settings,
            _share_of(context, number, int(group.max()) + 1),
        )  # fmt: skip
        groups[f"group_{number}"] = describe_group(part, o.frames[mine], free, scale, o)
        parts.append((mine, part))
    context.progress(0.9, "stability")
    model = fitted_model(o, settings.loss, node, started, data, parts, groups, out, train)
    if not out.any():
        context.say("too few frames to hold any out: the fit is judged on its own frames")
    return {
        "recording": o.recording,
        "length": o.length,
        "frames": o.frames,
        "models": {"nominal": model},
    }


def calmest(frames: np.ndarray, setup: Setup, least: int) -> np.ndarray:
    """Of frames (their indices) of a rope in motion, those in which it accelerates least, `least`
    of them or more: there a model at rest is nearest to the truth. All of a rope at rest."""
    if setup.motion is None:
        return frames
    size = setup.motion.acceleration[torch.from_numpy(frames)].square().sum(-1).mean(-1)
    if float(size.median().sqrt()) < LIVELY * float(setup.gravity.norm()):
        return frames
    count = max(least, round(CALM * len(frames)))
    return np.sort(frames[np.argsort(size.numpy(), kind="stable")[:count]])


def held_node(o: Observations, control_at: float | None) -> int:
    """The control point as a node: an end. Raises WrongUsage for a place inside."""
    node = node_at(o, control_at)
    if 0 < node < len(o.node_arc) - 1:
        raise WrongUsage(
            f"--control-at {control_at:g}: the equilibrium rope is held at its ends only; give 0 "
            f"or {o.length:g}, or --solver thomas"
        )
    return node


def given_values(o: Observations, settings: IdentifySettings, context: Context) -> dict[str, float]:
    """Where parameters start or stay, as told: another run's, then the user's. Raises
    WrongUsage."""
    if not settings.from_run:
        return settings.start
    return (
        frozen_values(context.external["from"], f"--from {context.external['from_path']}", o)
        | settings.start
    )


def free_names(settings: IdentifySettings, o: Observations) -> list[str]:
    """The parameters that are fitted. Raises WrongUsage."""
    free = settings.free
    if free is None and settings.from_run:
        return []
    if free is None:
        return ["EI"] + (["length"] if o.length_source == "estimated" else [])
    free = rest_curve.spelled_out(free)
    for name in free:
        if name not in (*NAMES, *rest_curve.NAMES):
            known = ", ".join((*NAMES, *rest_curve.UNIFORM, rest_curve.SHORT))
            raise WrongUsage(f"unknown parameter {name}; one of {known}")
    return free


def unit_scale(o: Observations) -> dict[str, tuple[float, str]]:
    """Factor and unit in which each parameter is told: ratios to the weight if no mass is known."""
    weight = 1.0 if o.mass else 1.0 / float(np.linalg.norm(o.gravity))
    rigid = "N m^2" if o.mass else "m^3"
    return {
        "EI": (weight, rigid),
        "GJ": (weight, rigid),
        "EA": (weight, "N" if o.mass else "m"),
        "length": (1.0, "m"),
        **dict.fromkeys(rest_curve.NAMES, (1.0, "1/m")),
    }


def started_setup(
    setup: Setup, start: dict[str, float], scale: dict[str, tuple[float, str]]
) -> Setup:
    """The setup with some parameters set. Raises WrongUsage for values out of reach."""
    for name in sorted(start):  # EI before GJ, which otherwise follows it
        if name in rest_curve.NAMES:
            curvature = torch.tensor([start[name]], dtype=torch.float64)
            setup = rest_curve.apply(name)(setup, curvature)
            continue
        if name not in NAMES:
            raise WrongUsage(f"unknown parameter {name}; one of {', '.join(NAMES)}")
        value = start[name] / scale[name][0]
        _, low, high = ranges(setup)[name]
        if not low <= value <= high:
            f = scale[name][0]
            raise WrongUsage(
                f"start {name} = {start[name]:g} is outside its bounds {low * f:g}..{high * f:g}"
            )
        given = torch.tensor([value], dtype=torch.float64)
        setup = setup.after(lambda s, apply=ROPE[name], v=given: apply(s, v))
    return setup


def rope_terms(setup: Setup, free: list[str]) -> list[Term]:
    """One term for each free parameter, starting where the setup has it."""
    known = ranges(setup)
    terms = []
    for name in sorted(free):
        if name in rest_curve.NAMES:
            terms.append(rest_curve.term(name, setup))
            continue
        start, low, high = known[name]
        start = 1e3 * low if not np.isfinite(start) else start
        terms.append(rope_term(name, "", start, low, high, ROPE[name]))
    return terms


def noise_of(o: Observations, data: Data) -> Noise:
    """White noise only: that of markers is measured by preprocess, that of points by stations."""
    return Noise(marker=float(np.median(o.noise)) if data.material else 0.0)


def priors_of(o: Observations) -> Priors:
    """The recording's own priors over the defaults. Two markers tell a clamp's direction badly."""
    given = {k: v for k, v in o.priors.model_dump().items() if v is not None}
    pairs = {} if o.end_twist_known else {"end_orientation": PAIR}
    return Priors(**(pairs | given))


def _share_of(context: Context, number: int, groups: int) -> Progress:
    """The progress of one group's fit as the stage's, from 5 to 85 %."""

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
) -> tuple[Fit, Noise]:
    """Fit the free parameters and the calibration errors, noise estimated on the way.

    Raises NotConverged when no start settles.
    """
    bins, noise = len(o.node_arc) - 1, noise_of(o, data)
    best: Fit | None = None
    terms = rope_terms(setup, free)
    screened = SCREEN if "EI" in free else (0.0,)
    for count, shift in enumerate(screened):
        progress(0.5 * count / len(screened), "where to start")
        forward = Forward(setup, terms)
        place = next((k for k, t in enumerate(terms) if t.name == "EI"), 0)
        start = forward.start()
        if start.size:
            start[place] = shift
        forward.last = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
        try:
            found = fit(forward, data, noise, bins, start, 12 if start.size else 1)
        except ArithmeticError:
            continue
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise NotConverged("no frame reaches an equilibrium; look at the ends and the length")
    last = nearer_branch(best, data, bins)
    progress(0.5, "least squares")
    # What the rope misses must not be forced on the errors of the set-up.
    loose = max(1.0, best.scale) if data.material else 1.0
    full = Forward(setup, [*terms, *calibration(setup, priors_of(o), o.ends_assumed)], last)
    return calibrated_fit(full, best.point.u, data, noise, bins, evaluations, loose)


def calibrated_fit(
    full: Forward,
    rope: np.ndarray,
    data: Data,
    noise: Noise,
    bins: int,
    evaluations: int,
    loose: float,
) -> tuple[Fit, Noise]:
    """Fit rope and calibration together, from search variables `rope` of the first terms; measure
    what is left of noise, and fit once more under it. loose: how many times the markers' noise the
    rope alone misses; the errors of the set-up may take their share of that."""
    start = full.start()
    start[: rope.size] = rope
    first = fit(full, data, replace(noise, marker=loose * noise.marker), bins, start, evaluations)
    missed = max(1.0, loose * first.scale) if loose > 1 else 1.0
    noise = estimate(first.stations, Noise(marker=missed * noise.marker))
    return fit(full, data, noise, bins, first.point.u, evaluations), noise


def nearer_branch(result: Fit, data: Data, bins: int) -> Solution:
    """Of two stable states of a frame, the one that the data show."""
    point = result.point
    found, apart = other_states(point.solution)
    last = point.solution.copy()
    for t in np.flatnonzero(np.isfinite(apart)):
        one = np.array([t])
        gaps = [
            np.median(np.abs(match(data.frames(one), s.x[one], bins).residual))
            for s in (last, found)
        ]
        if gaps[1] < gaps[0]:
            last.put(t, found, t)
    return last


def _fit_group(
    setup: Setup,
    data: Data,
    inside: np.ndarray,
    free: list[str],
    o: Observations,
    settings: IdentifySettings,
    progress: Progress,
) -> Part:
    """Fit on the training frames (mask `inside`), then settle all of the group's frames."""
    few, seen = setup.frames(torch.from_numpy(np.flatnonzero(inside))), data.frames(inside)
    found, noise = nominal_fit(few, seen, free, o, settings.evaluations, progress)
    progress(0.9, "intervals")
    told = limits(found, seen, noise, len(o.node_arc) - 1)
    whole = Forward(setup, found.forward.terms)
    start = follow(whole.setup_at(found.point.u).rod(), whole.conditions_at(found.point.u)).states
    start.put(inside, found.point.solution)
    return found, noise, whole.at(found.point.u, start), told
