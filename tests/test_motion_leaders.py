"""What leads a diagnosis in motion: noise measured beside the leader, clamps at pinned ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.beside_leader import with_noise_beside_leader
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import effects_of, hypotheses
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.rod.setup import bare
from tests.test_diagnosis_of_motion import FREE, driven, model, recorded

MISTAKEN = Noise(marker=0.01, repeats=60.0)  # a mismatch, taken for noise


@pytest.fixture(scope="module")
def lengthened():
    """A rope 3 % longer than told, as a fit leaves it that takes the mismatch for noise."""
    effect = next(e for e in effects_of(driven(24)) if e.name == "length_error")
    lines, data = recorded(effect, [0.03], seed=5)
    return fit(model(driven(24), lines, FREE), FitProblem(data, MISTAKEN, 12), None, 10)


def leader(current):
    (one,) = hypotheses(current.point.setup, ("length_error",))
    found = fit_candidate(current, one, np.array([0.02]))
    assert found is not None
    return found


def test_what_the_leader_explains_is_no_noise(lengthened):
    before = leader(lengthened)
    current, (after, *_) = with_noise_beside_leader(lengthened, [before], 6.0)
    assert current.problem.noise.marker < 0.25 * MISTAKEN.marker
    assert after.evidence > 2 * before.evidence
    assert after.values()[0] == pytest.approx(0.03, abs=0.004)


def test_noise_stays_where_the_leader_leaves_it(lengthened):
    right = replace(MISTAKEN, marker=0.001)
    problem = lengthened.problem.under(right)
    current = fit(lengthened.forward, problem, lengthened.point.u, 5)
    before = [leader(current)]
    assert with_noise_beside_leader(current, before, 6.0) == (current, before)


def test_a_clamp_is_looked_for_at_a_pinned_end_in_motion():
    clamped = driven(24)
    none = np.full_like(clamped.clamp, np.nan)
    view = np.array([0.0, -2.0, 0.0])
    pinned = bare(clamped.properties, clamped.gravity, clamped.ends, none, view)
    pinned = pinned._replace(damping=clamped.damping)
    lines, data = recorded(None, [], seed=5)
    found = fit(model(pinned, lines), FitProblem(data, Noise(marker=0.002), 12), None, 1)
    both = hypotheses(pinned, ("clamped_end",))
    assert len(both) == 2
    for one in both:
        moved = Sensitivities(found).of(one).values
        assert moved.shape[1:] == (14, 1)
        assert np.abs(moved).max(axis=0).min() > 0


def test_a_sensor_without_errors_reports_the_nodes_themselves():
    setup = driven(4)
    x = np.random.default_rng(0).random((len(setup.ends), 5, 3))
    assert setup.sensor(x) is x


@pytest.mark.parametrize("name", ["rotation", "gain", "shift", "depth", "flat", "lag"])
def test_derivatives_with_respect_to_errors_that_are_zero(name):
    setup = driven(4)
    x = np.random.default_rng(0).random((len(setup.ends), 5, 3))
    sensor = setup.sensor._replace(normal=np.ones_like(setup.sensor.normal))
    zero = getattr(sensor, name)
    assert not zero.any()
    for direction in np.eye(zero.size).reshape(-1, *zero.shape):
        low, high = (sensor._replace(**{name: h * direction})(x) for h in (-1e-6, 1e-6))
        assert np.abs((high - low) / 2e-6).max() > 0.01
