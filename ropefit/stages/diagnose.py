"""diagnose: what the nominal model left out, from observations and the identified rope."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from pydantic import Field
from threadpoolctl import threadpool_limits

from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference import rest_curve
from ropefit.inference.correlated import correlated
from ropefit.inference.diagnosis import search as engine
from ropefit.inference.diagnosis.background import on_edge
from ropefit.inference.equilibrium_rope import ranges
from ropefit.inference.forward import Forward, Term
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.terms import ROPE, calibration, rope_term
from ropefit.inference.uncertainty import INTERVAL
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.branches import follow
from ropefit.stages.diagnosis_content import content
from ropefit.stages.equilibrium_model import calibration_name
from ropefit.stages.frames import spread_evenly
from ropefit.stages.frozen import covariance_of, frozen_values
from ropefit.stages.identify_equilibrium import (
    nearer_branch,
    noise_of,
    priors_of,
    started_setup,
    unit_scale,
)
from ropefit.stages.rope_setup import STATIONS, base_setup, data_in_space, segments_of, surface_sd
from ropefit.stages.shapes_only import shapes_only
from ropefit.stages.stage import Context, Stage, StageSettings

FEWEST = 4  # frames
GJ_SD = 0.5  # of the logarithm of GJ/EI, whose usual value is that of a solid round section
THROUGH = 2  # times the frames that are compared: those that a rope with memory goes through


class DiagnoseSettings(StageSettings):
    """seed of the replicates; most_frames used, evenly spread; nominal: another run's rope;
    calibration: another run's camera and gravity."""

    seed: int = 0
    most_frames: int = Field(default=48, ge=4)
    nominal: bool = False
    calibration: bool = False


def compute(inputs: dict[str, Any], settings: DiagnoseSettings, context: Context) -> dict[str, Any]:
    """The contents of diagnosis.h5. Raises BadInput, NotConverged, WrongUsage."""
    o: Observations = inputs[Observations.file_name]
    model: Model = inputs[Model.file_name]
    shapes_only(model.nominal, "diagnose")
    if model.nominal.balance is None:
        raise WrongUsage(
            f"the model was fitted by {model.nominal.solver}, whose weights are no properties of "
            "the rope; run ropefit identify --solver equilibrium first"
        )
    if o.source == "rgbd" and len(o.points) == 0:
        raise BadInput("no points in space: the diagnosis needs depth, clouds or markers")
    segments = segments_of(o)
    every, setup = segments // (len(o.node_arc) - 1), base_setup(o, segments)
    used = spread_evenly(
        np.arange(len(o.frames)), np.zeros(len(o.frames), dtype=np.int64), settings.most_frames
    )
    setup, data = compared(setup, used, settings.most_frames), data_in_space(o).frames(used)
    source = context.external["nominal"] if settings.nominal else model
    terms, setup = nominal_terms(o, source, setup, prior=settings.nominal)
    noise = noise_of(o, data)
    if settings.nominal:
        noise = with_what_is_missed(noise, source, o)
    bins = STATIONS
    context.progress(0.02, "nominal fit")
    with threadpool_limits(1, "blas"):  # small matrices: threads only wait for each other
        errors = calibration(setup, priors_of(o), o.ends_assumed, surface_sd(o))
        if settings.calibration:
            errors = calibrated(errors, context.external["calibration"])
        nominal = _nominal(setup, [*terms, *errors], data, noise, bins)
        found = None
        for _ in range(2):  # with what is found, other frames may come to the edge
            edge = on_edge(found.final if found else nominal)
            if (~edge).sum() < FEWEST:
                if found:
                    break
                raise BadInput(
                    "nearly every frame is at the edge of its stability, where a hair's breadth "
                    "decides the shape; record poses in which the rope hangs firmly"
                )
            if edge.any():
                told = ", ".join(map(str, o.frames[used[edge]]))
                context.say(f"left out, at the edge of stability: frames {told}")
                firm = np.flatnonzero(~edge)
                used, data = used[firm], data.frames(firm)
                setup = setup.frames(torch.from_numpy(firm))
                nominal = _nominal(setup, [*terms, *errors], data, noise, bins)
            if found is None or edge.any():
                found = engine.search(nominal, data, noise, bins, settings.seed, context.progress)
        assert found is not None
        return content(o, found, used, every, bins)


def compared(setup: Setup, used: np.ndarray, most: int) -> Setup:
    """The setup in the frames `used`, which a rope with memory comes to through some of the
    others: as many again, evenly spread."""
    every = np.arange(len(setup.ends))
    between = spread_evenly(every, np.zeros_like(every), THROUGH * most)
    passed = np.union1d(used, between)
    through = setup.frames(torch.from_numpy(passed))._replace(past=None)
    return through.frames(torch.from_numpy(np.searchsorted(passed, used)))


def nominal_terms(
    o: Observations, source: Model, setup: Setup, prior: bool
) -> tuple[list[Term], Setup]:
    """The rope's own parameters, starting where they were identified; at their usual values where
    the search ran to a bound.

    prior: they are known from another run, within that run's intervals, and the points of a rest
    curve, which hang together, within its covariance. GJ joins them where both clamps hold twist.
    """
    scale = unit_scale(o)
    group = next(iter(source.nominal.groups.values()))
    if prior:
        values = {k: v for k, v in frozen_values(source, "--nominal", o).items() if k != "EA"}
    else:
        values = {
            name: p.value
            for name, p in group.parameters.items()
            if name in ("EI", "GJ", *rest_curve.NAMES) and p.verdict not in ("fixed", "at bound")
        }
    curve = {name: values.pop(name) for name in rest_curve.NAMES if name in values}
    setup = started_setup(setup, values, scale)
    names = ["EI"]
    if all(setup.clamped) and bool(torch.isfinite(setup.clamp_compliance).all()):
        names.append("GJ")
    if o.length_source == "estimated":
        names.append("length")
    known = ranges(setup)
    terms = []
    for name in names:
        start, low, high = known[name]
        term = rope_term(name, "", start, low, high, ROPE[name])
        if name == "GJ":  # where no twist is seen it would go astray
            term = _with_prior(term, GJ_SD)
        p = group.parameters.get(name)
        if prior and p is not None and p.ci95 is not None:
            sd = 0.5 * np.log(p.ci95[1] / p.ci95[0]) / INTERVAL
            term = _with_prior(term, sd)
        terms.append(term)
    bends = {
        name: replace(rest_curve.term(name, setup), start=np.array([value]))
        for name, value in curve.items()
    }
    seen = [name for name in bends if prior and group.parameters[name].ci95 is not None]
    if seen:
        covariance = covariance_of(group, seen)
        terms.append(correlated(rest_curve.SHORT, [bends.pop(n) for n in seen], covariance))
    return [*terms, *bends.values()], setup


def with_what_is_missed(noise: Noise, source: Model, o: Observations) -> Noise:
    """The noise of markers, no smaller than what the rope of another recording misses there: it
    will miss as much here, and that is no cause."""
    if o.source != "markers" or source.recording == o.recording:
        return noise
    return replace(noise, marker=max(noise.marker, source.nominal.rms_fit / 3**0.5))


def _with_prior(term: Term, sd: float) -> Term:
    return replace(term, prior=np.array([max(sd, 1e-4)]))


def calibrated(errors: list[Term], source: Model) -> list[Term]:
    """The errors of camera and gravity as another run of the same set-up found them, and only as
    uncertain; the ends are held anew in every recording. Raises WrongUsage."""
    if source.nominal.balance is None or not source.nominal.balance.calibration:
        raise WrongUsage(
            "--calibration: that run has no calibration; identify it with --solver equilibrium"
        )
    known = source.nominal.balance.calibration
    out = []
    for term in errors:
        found = [known.get(calibration_name(term, axis)) for axis in term.names]
        if term.name.startswith(("end_", "clamp_")) or None in found:
            out.append(term)
            continue
        value = np.array([item.value for item in found if item])
        sd = np.array([item.sd for item in found if item])
        prior = np.clip(sd, 1e-3 * term.prior, term.prior)
        out.append(replace(term, start=value, prior=prior))
    return out


def _nominal(setup: Setup, terms: list[Term], data, noise: Noise, bins: int) -> Fit:
    forward = Forward(setup, terms)
    start = forward.start()
    forward.last = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
    try:
        # Twist is a small correction: while the set-up's errors are still large it would be misled.
        late = np.repeat([t.name == "GJ" for t in terms], [t.size for t in terms])
        if late.any():
            early = Forward(setup, [t for t in terms if t.name != "GJ"], forward.last)
            start[~late] = fit(early, data, noise, bins, None, 30, tolerance=1e-4).point.u
            forward.last = early.last
        first = fit(forward, data, noise, bins, start, 30, tolerance=1e-5)
        forward.last = nearer_branch(first, data, bins)
        return fit(forward, data, noise, bins, first.point.u, 30, tolerance=1e-5)
    except ArithmeticError as error:
        raise NotConverged(f"{error}; look at the ends and the length of the recording")


STAGE = Stage(name="diagnose", reads=(Observations, Model), writes=Diagnosis, compute=compute)
