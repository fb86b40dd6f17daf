"""The nominal model of a diagnosis at rest: the rope as identified, with errors of the set-up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.frozen import covariance_of, frozen_values
from ropefit.adapters.priors import priors_of
from ropefit.adapters.rope_setup import surface_sd
from ropefit.adapters.start_values import started_setup
from ropefit.artifacts import Model, Observations
from ropefit.artifacts.model import Parameter
from ropefit.effects.place import QUARTERS, between_quarters
from ropefit.errors import NotConverged, WrongUsage
from ropefit.fitting.branch import nearer_branch
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models import rest_curve
from ropefit.models.correlated import correlated
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.priors import calibration, nuisance
from ropefit.models.terms import Term, merged
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.branches import follow

GJ_PRIOR_SD = 0.5  # of the logarithm of GJ/EI, about that of a solid round section
LEAST_PRIOR_SD = 1e-4  # search variables
# Of the logarithm of a rigidity known from another recording: handling changes it, and what the
# model lacks there (a fitting at the tip that nobody tells) is a part of it.
RIGIDITY_SD = 0.1
# The same of how it varies along a rope.
UNEVEN_SD = 0.15
LEAST_CALIBRATION_SD = 1e-3  # of the usual prior: however well another run knows an error


def nominal_terms(
    o: Observations, source: Model, setup: Setup, prior: bool, elsewhere: bool = False,
    uneven: bool = False,
) -> tuple[list[Term], Setup]:  # fmt: skip
    """Return the rope's own parameters, starting where they were identified; at their usual values
    where the search ran to a bound.

    prior: they are known from another run, within that run's intervals, and the points of a rest
    curve, which are correlated, within its covariance. GJ joins them where both clamps hold twist.
    elsewhere: in another recording; rigidities are then no better known than `RIGIDITY_SD`. uneven:
    they need not be uniform.
    """
    group = next(iter(source.nominal.groups.values()))
    if prior:
        kept = ("EI", "GJ", "length", *rest_curve.NAMES)
        values = {k: v for k, v in frozen_values(source, "--nominal", o).items() if k in kept}
    else:
        values = {
            name: p.value
            for name, p in group.parameters.items()
            if name in ("EI", "GJ", *rest_curve.NAMES) and p.verdict not in ("fixed", "at bound")
        }
    curve = {name: values.pop(name) for name in rest_curve.NAMES if name in values}
    setup = started_setup(setup, values, o)
    names = ["EI"]
    if all(setup.clamped) and np.isfinite(setup.clamp_compliance).all():
        names.append("GJ")
    if o.length_source == "estimated":
        names.append("length")
    terms = []
    for name in names:
        term = PARAMETERS[name].term(setup)
        if name == "GJ":  # without visible twist it is undetermined
            term = _with_prior(term, GJ_PRIOR_SD)
        p = group.parameters.get(name)
        if prior and p is not None:
            changed = elsewhere and name in ("EI", "GJ")
            term = as_known(term, p, RIGIDITY_SD if changed else LEAST_PRIOR_SD)
        terms.append(term)
    bends = {name: PARAMETERS[name].term(setup, value) for name, value in curve.items()}
    seen = [name for name in bends if prior and group.parameters[name].ci95 is not None]
    if seen:
        covariance = covariance_of(group, seen)
        known = [bends.pop(name) for name in seen]
        terms.append(correlated(rest_curve.SHORT, known, covariance, rest_curve.apply(*seen)))
    if uneven:
        names, size = [f"at_{place}" for place in QUARTERS], len(QUARTERS)
        terms.append(nuisance("rigidity", names, ["1"] * size, _uneven, [UNEVEN_SD] * size))
    if bends:
        terms.append(merged(rest_curve.SHORT, [*bends.values()], rest_curve.apply(*bends)))
    return terms, setup


def _uneven(setup: Setup, v: np.ndarray) -> Setup:
    """Return a rope whose rigidity has these logarithms (5,) of factors at the quarters."""
    p = setup.properties
    return setup._replace(properties=p._replace(bend=p.bend * np.exp(between_quarters(setup) @ v)))


def with_what_is_missed(noise: Noise, source: Model, measured: float = np.inf) -> Noise:
    """Return the noise of markers, no smaller than the rms misfit of the rope in another recording:
    as much misfit here has no cause of its own. measured [m]: the noise of a coordinate there;
    infinite if only what is told here counts."""
    missed = source.nominal.rms_fit / 3**0.5
    sensor = min(noise.sensor or noise.marker, measured)
    own = noise.marker if noise.sensor else sensor
    return replace(noise, marker=max(own, missed), sensor=sensor)


def as_known(term: Term, p: Parameter, least: float = LEAST_PRIOR_SD) -> Term:
    """Return a parameter's term with the uncertainty of another fit as its prior, `least` (search
    variable) or more."""
    if p.ci95 is None:
        return term
    low, high = np.log(p.ci95) if term.log else p.ci95
    return _with_prior(term, max(0.5 * (high - low) / NORMAL_QUANTILE, least))


def _with_prior(term: Term, sd: float) -> Term:
    return replace(term, prior=np.array([sd]))


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


def nominal_at_rest(
    setup: Setup, terms: list[Term], problem: FitProblem, coarser: Setup | None = None
) -> Fit:
    """Fit the nominal model; coarser: the same rope of fewer segments. Raises NotConverged."""
    forward = Equilibrium(setup, terms, coarser=coarser)
    start = forward.start()
    states = follow(forward.setup_at(start).rod(), forward.conditions_at(start))
    forward = forward.starting_from(states)
    try:
        # Twist is a small correction: while the set-up's errors are still large it would be misled.
        late = np.repeat([t.name == "GJ" for t in terms], [t.size for t in terms])
        if late.any():
            early = Equilibrium(setup, [t for t in terms if t.name != "GJ"], states)
            start[~late] = fit(early, problem, None, 30, tolerance=1e-4).point.u
            assert early.last is not None
            forward = forward.starting_from(early.last)
        first = fit(forward, problem, start, 30, tolerance=1e-5)
        forward = first.forward.starting_from(nearer_branch(first))
        return fit(forward, problem, first.point.u, 30, tolerance=1e-5)
    except ArithmeticError as error:
        raise NotConverged(f"{error}; look at the ends and the length of the recording")
