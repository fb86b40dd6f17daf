"""What is reported at the end: at the minimum, whatever a fit began from, and open where it is."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.adapters.diagnosis_content import holding_both, sizes_of
from ropefit.diagnosis import last_fit as last_fit_module
from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.alternatives import alternatives
from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.last_fit import last_fit
from ropefit.diagnosis.reassessment import without_effects
from ropefit.effects import (
    DistributedLoad,
    GravityMisalignment,
    IntrinsicCurvature,
    PointMass,
    WeightError,
)
from ropefit.inference.least_squares import Fit, attempted, fit
from ropefit.inference.noise import Noise
from ropefit.inference.objective import LEFT
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.terms import SIZE_PRIOR_SD
from tests.concealed import nominal_fit, recorded, rope
from tests.test_followers import clamped, nominal_clamped
from tests.test_least_squares import BINS, SD, ends, markers, setup

MASS, PLACE, LOAD = 0.006, 0.37, (0.0, 0.06, 0.0)  # kg, m, N/m


@pytest.fixture(scope="module")
def loaded():
    """A weight and a load across gravity, as fitted from a load that lifts the rope, too."""
    setup = PointMass().apply(rope(144), np.array([MASS, PLACE]))
    setup = DistributedLoad().apply(setup, np.array(LOAD))
    nominal = nominal_fit(recorded(setup, seed=3), 72)
    hypotheses = [Hypothesis(effect, NO_PLACE) for effect in (DistributedLoad(), PointMass())]
    starts = (np.array([0.0, 0.06, 0.15]), np.array([MASS, PLACE]))
    begun = settled_start(nominal, list(zip(hypotheses, starts, strict=True)))
    assert begun is not None
    fitted = attempted(begun.forward, nominal.problem, begun.values, 40, tolerance=1e-6)
    assert fitted is not None
    pairs = zip(hypotheses, begun.terms, strict=True)
    return [Candidate(h, term, fitted, 0.0, np.zeros(0)) for h, term in pairs], fitted


def test_a_load_along_gravity_is_open_and_taken_as_least(loaded):
    """No shape at rest tells it: everything else would be as wrong as the weight is."""
    (load, mass), fitted = loaded
    before = replace(load, fit=fitted)
    assert abs(before.values()[2]) > 0.03  # where the fit happened to end
    assert abs(replace(mass, fit=fitted).values()[0] / MASS - 1) > 0.05
    usual = load.term.scale[2]
    assert before.sd()[2] == pytest.approx(SIZE_PRIOR_SD * usual, rel=0.05)
    found = last_fit(fitted)
    assert found.cost == pytest.approx(fitted.cost, abs=3.0)
    for candidate, truth in ((load, LOAD), (mass, (MASS, PLACE))):
        one = replace(candidate, fit=found)
        assert (np.abs(one.values() - truth) < 2 * one.sd()).all()
    assert replace(load, fit=found).values()[2] == pytest.approx(0.0, abs=usual)
    assert replace(mass, fit=found).values()[0] == pytest.approx(MASS, rel=0.04)
    # The width is that of the weight, of which nothing is known but that prior.
    assert replace(mass, fit=found).sd()[0] > 0.05 * MASS


def test_a_well_determined_size_is_as_wide_as_the_noise_makes_it(loaded):
    (load, _), fitted = loaded
    along = replace(load, fit=fitted).covariance()[1, 1]
    by_noise = replace(load, fit=fitted).covariance(by_noise=True)[1, 1]
    assert by_noise <= along < SIZE_PRIOR_SD**2 / 20


def test_a_weight_beside_an_error_of_gravity_may_be_that_beside_a_load(loaded):
    """What stands in the place of one effect is fitted beside the other."""
    (load, mass), fitted = loaded
    tilt = Hypothesis(GravityMisalignment(), NO_PLACE)
    without = without_effects(fitted, load)
    assert without is not None
    error = fit_candidate(without, tilt, np.array([0.1, 0.0]))
    assert error is not None
    tilted = [Accepted(error, [load], 0.0, 1.0), Accepted(mass, [], 0.0, 1.0)]
    # As good only if that is so in data: here the weight tilts with gravity, and does not fit.
    ((item, beside),) = alternatives(error.fit, tilted, 6.0)
    assert item is tilted[0]
    assert beside.cost < error.fit.cost
    assert replace(mass, fit=beside).values()[0] == pytest.approx(MASS, rel=0.04)
    assert not alternatives(error.fit, tilted[1:], 6.0)


def test_beside_an_effect_of_little_evidence_there_is_also_what_holds_without_it(
    loaded, monkeypatch
):
    """On a rope that is known only up to what its model misses."""
    effects, fitted = loaded
    accepted = [Accepted(one, [], 0.0, 1.0) for one in effects]
    assert not alternatives(fitted, accepted, 1e6)  # the rope is not known from elsewhere
    assert fitted.covariance is not None  # as of a rope by itself
    monkeypatch.setattr(Fit, "known_elsewhere", property(lambda one: one is fitted))
    assert not alternatives(fitted, accepted, 6.0)  # both are beyond doubt
    without = alternatives(fitted, accepted, 1e6)
    assert [item for item, _ in without] == accepted
    for item, beside in without:
        assert item.candidate.term not in beside.forward.terms
        assert beside.cost > fitted.cost
        assert beside.converged


def test_intervals_hold_both_of_two_fits(loaded):
    (_, mass), fitted = loaded
    here, there = replace(mass, fit=fitted), replace(mass, fit=last_fit(fitted))
    sizes = sizes_of(here, here.values(), here.sd())
    both = holding_both(sizes, there)
    other = sizes_of(there, there.values(), there.sd())["mass"].ci95
    assert both["mass"].value == sizes["mass"].value
    assert both["mass"].ci95[0] == min(sizes["mass"].ci95[0], other[0])
    assert both["mass"].ci95[1] == max(sizes["mass"].ci95[1], other[1])
    assert other != sizes["mass"].ci95


def test_a_fit_does_not_depend_on_the_shape_it_began_from():
    """Points are matched to the rope where a fit begins: from afar they are matched wrongly."""
    curvature = [1.2, 0.4, 0.5, 0.6]
    setup = IntrinsicCurvature().apply(clamped(96, 8), np.array(curvature))
    nominal = nominal_clamped(recorded(setup, seed=5))
    hypothesis = Hypothesis(IntrinsicCurvature(), NO_PLACE)
    starts = (curvature, [1.6, 0.0, 0.5, 0.8])
    one, other = (fit_candidate(nominal, hypothesis, np.array(start)) for start in starts)
    assert one is not None
    assert other is not None
    assert other.evidence == pytest.approx(one.evidence, abs=0.5)
    assert (np.abs(other.values() - one.values()) < 0.3 * one.sd()).all()


def test_a_weight_in_wrong_units_is_no_better_known_than_the_rigidity():
    """At rest shapes show their ratio only, however many usual sizes it is."""
    data, told = markers(setup(60, ends())), setup(30, ends())
    told = told._replace(gravity=told.gravity / 8)
    rigidity = replace(PARAMETERS["EI"].term(told), prior=np.array([0.2]))
    weight = Hypothesis(WeightError(), NO_PLACE).term(told, np.array([2.0]))
    problem = FitProblem(data, Noise(marker=5 * SD, sensor=SD), BINS)
    found = last_fit(fit(Equilibrium(told, [rigidity, weight]), problem))
    excess, sd = weight.value(found.point.u[1:])[0], found.sd()[1] * weight.scale[0]
    assert found.misses
    assert sd > 0.2 * (1 + excess)
    assert abs(excess - 7.0) < found.quantile * sd


def test_a_fit_that_ended_far_from_its_minimum_is_led_there(loaded, monkeypatch):
    """It may end as converged where its steps, not what is left to gain, have become small."""
    _, fitted = loaded
    # That fits once more, too.
    monkeypatch.setattr(last_fit_module, "_with_least_sizes", lambda found: found)
    aside = 0.2 * np.ones_like(fitted.point.u)
    forward = fitted.forward.starting_from(fitted.point.solution)
    early = attempted(forward, fitted.problem, fitted.point.u + aside, 40, tolerance=0.9)
    assert early is not None
    assert early.converged
    assert early.as_matched
    assert early.left_to_gain > LEFT
    found = last_fit(early)
    assert found.left_to_gain < LEFT
    assert found.cost < early.cost


def test_a_fit_that_goes_back_to_where_it_was_is_not_moved_again(loaded, monkeypatch):
    _, fitted = loaded
    refits = []
    step = 0.1 * np.ones_like(fitted.point.u)
    monkeypatch.setattr(last_fit_module, "_to_least_sizes", lambda found: step)
    monkeypatch.setattr(
        last_fit_module, "_refitted", lambda found, step, needed: refits.append(step) or found
    )
    assert last_fit_module._with_least_sizes(fitted) is fitted
    assert len(refits) == 1


@pytest.mark.parametrize(("ended", "rounds"), [(True, 1), (False, last_fit_module.ROUNDS)])
def test_after_too_many_evaluations_fits_are_repeated_once(loaded, monkeypatch, ended, rounds):
    _, fitted = loaded
    refits, steps = [], iter(0.5 ** np.arange(9)[:, None] * np.ones_like(fitted.point.u))
    monkeypatch.setattr(fitted.problem.work, "exhausted", ended)
    monkeypatch.setattr(last_fit_module, "_to_least_sizes", lambda found: next(steps))
    monkeypatch.setattr(
        last_fit_module, "_refitted", lambda found, step, needed: refits.append(step) or found
    )
    last_fit_module._with_least_sizes(replace(fitted, cost=0.0))
    assert len(refits) == rounds
