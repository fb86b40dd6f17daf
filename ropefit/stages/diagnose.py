"""diagnose: the physics or measurement errors that the nominal model leaves out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from ropefit.adapters.diagnosis_content import content
from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.frames import spread_evenly
from ropefit.adapters.frozen import covariance_of, frozen_values
from ropefit.adapters.priors import noise_of, priors_of
from ropefit.adapters.rope_setup import STATIONS, base_setup, data_in_space, segments_of, surface_sd
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.adapters.shapes_only import shapes_only
from ropefit.adapters.start_values import started_setup
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis import search as engine
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.diagnosis.rules import RULES, Rules
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.fitting.branch import nearer_branch
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.sandwich import INTERVAL
from ropefit.models import rest_curve
from ropefit.models.correlated import correlated
from ropefit.models.equilibrium import Forward, Term
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import calibration
from ropefit.rod.setup import Setup
from ropefit.runs.protocol import Context
from ropefit.solvers.equilibrium.branches import follow

FEWEST_FRAMES = 4
GJ_PRIOR_SD = 0.5  # of the logarithm of GJ/EI, about that of a solid round section
PATH_FRAMES = 2  # times the compared frames: those that a path-dependent rope goes through
LEAST_PRIOR_SD = 1e-4  # search variables
LEAST_CALIBRATION_SD = 1e-3  # of the usual prior: however well another run knows an error


def compute(inputs: dict[str, Any], settings: DiagnoseSettings, context: Context) -> dict[str, Any]:
    """Return the contents of diagnosis.h5. Raises BadInput, NotConverged, WrongUsage."""
    return diagnosed(inputs, settings, context, RULES)


def diagnosed(
    inputs: dict[str, Any], settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Return the contents of diagnosis.h5 by other rules. Raises like `compute`."""
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
        known = context.external["calibration"] if settings.calibration else None
        errors = set_up_errors(setup, o, known) if rules.calibration else []
        nominal = _nominal(setup, [*terms, *errors], data, noise, bins)
        result = None
        for _ in range(2):  # with an effect, other frames may be near instability
            edge = on_edge(result.final if result else nominal)
            if (~edge).sum() < FEWEST_FRAMES:
                if result:
                    break
                raise BadInput(
                    "nearly every frame is at the edge of its stability, where a hair's breadth "
                    "decides the shape; record poses in which the rope hangs firmly"
                )
            if edge.any():
                excluded = ", ".join(map(str, o.frames[used[edge]]))
                context.say(f"excluded, at the edge of stability: frames {excluded}")
                firm = np.flatnonzero(~edge)
                used, data = used[firm], data.frames(firm)
                setup = setup.frames(torch.from_numpy(firm))
                nominal = _nominal(setup, [*terms, *errors], data, noise, bins)
            if result is None or edge.any():
                result = engine.search(
                    nominal, data, noise, bins, settings.seed, context.progress, rules
                )
        assert result is not None
        return content(o, result, used, every, bins)


def compared(setup: Setup, used: np.ndarray, most: int) -> Setup:
    """Return the setup in the frames `used`, which a path-dependent rope reaches through some of
    the others: as many again, evenly spread."""
    every = np.arange(len(setup.ends))
    between = spread_evenly(every, np.zeros_like(every), PATH_FRAMES * most)
    passed = np.union1d(used, between)
    through = setup.frames(torch.from_numpy(passed))._replace(past=None)
    return through.frames(torch.from_numpy(np.searchsorted(passed, used)))


def nominal_terms(
    o: Observations, source: Model, setup: Setup, prior: bool
) -> tuple[list[Term], Setup]:
    """Return the rope's own parameters, starting where they were identified; at their usual values
    where the search ran to a bound.

    prior: they are known from another run, within that run's intervals, and the points of a rest
    curve, which are correlated, within its covariance. GJ joins them where both clamps hold twist.
    """
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
    setup = started_setup(setup, values, o)
    names = ["EI"]
    if all(setup.clamped) and bool(torch.isfinite(setup.clamp_compliance).all()):
        names.append("GJ")
    if o.length_source == "estimated":
        names.append("length")
    terms = []
    for name in names:
        term = PARAMETERS[name].term(setup)
        if name == "GJ":  # without visible twist it is undetermined
            term = _with_prior(term, GJ_PRIOR_SD)
        p = group.parameters.get(name)
        if prior and p is not None and p.ci95 is not None:
            sd = 0.5 * np.log(p.ci95[1] / p.ci95[0]) / INTERVAL
            term = _with_prior(term, sd)
        terms.append(term)
    bends = {name: PARAMETERS[name].term(setup, value) for name, value in curve.items()}
    seen = [name for name in bends if prior and group.parameters[name].ci95 is not None]
    if seen:
        covariance = covariance_of(group, seen)
        terms.append(correlated(rest_curve.SHORT, [bends.pop(n) for n in seen], covariance))
    return [*terms, *bends.values()], setup


def with_what_is_missed(noise: Noise, source: Model, o: Observations) -> Noise:
    """Return the noise of markers, no smaller than the rms misfit of the rope in the recording it
    was identified from: as much misfit here has no cause of its own."""
    if o.source != "markers" or source.recording == o.recording:
        return noise
    return replace(noise, marker=max(noise.marker, source.nominal.rms_fit / 3**0.5))


def _with_prior(term: Term, sd: float) -> Term:
    return replace(term, prior=np.array([max(sd, LEAST_PRIOR_SD)]))


def set_up_errors(setup: Setup, o: Observations, known: Model | None) -> list[Term]:
    """Return the calibration errors, those of camera and gravity as another run knows them."""
    errors = calibration(setup, priors_of(o), o.ends_assumed, surface_sd(o))
    return calibrated(errors, known) if known else errors


def calibrated(errors: list[Term], source: Model) -> list[Term]:
    """Return the errors of camera and gravity as another run of the same set-up has them, with its
    uncertainty; the ends are held anew in every recording. Raises WrongUsage."""
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
        prior = np.clip(sd, LEAST_CALIBRATION_SD * term.prior, term.prior)
        out.append(replace(term, start=value, prior=prior))
    return out


def _nominal(setup: Setup, terms: list[Term], data, noise: Noise, bins: int) -> Fit:
    forward = Forward(setup, terms)
    start = forward.start()
    states = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
    forward = forward.starting_from(states)
    try:
        # Twist is a small correction: while the set-up's errors are still large it would be misled.
        late = np.repeat([t.name == "GJ" for t in terms], [t.size for t in terms])
        if late.any():
            early = Forward(setup, [t for t in terms if t.name != "GJ"], states)
            start[~late] = fit(early, data, noise, bins, None, 30, tolerance=1e-4).point.u
            assert early.last is not None
            forward = forward.starting_from(early.last)
        first = fit(forward, data, noise, bins, start, 30, tolerance=1e-5)
        forward = first.forward.starting_from(nearer_branch(first, data, bins))
        return fit(forward, data, noise, bins, first.point.u, 30, tolerance=1e-5)
    except ArithmeticError as error:
        raise NotConverged(f"{error}; look at the ends and the length of the recording")
