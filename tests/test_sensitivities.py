"""Sensitivities at zero size of effects that change nothing smoothly there: what remembers the
frames before, and rest curvature of a rope that is free to spin."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.hypotheses import Hypothesis, hypotheses
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import (
    BendingHysteresis,
    FreeCurvature,
    FreeKink,
    PlasticSet,
    PointMass,
    Tether,
    ViscoelasticCreep,
)
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from tests.concealed import BINS, scanned
from tests.test_diagnosis_of_motion import FREE, driven, model, recorded
from tests.test_friction import ROUGH, rough, swept
from tests.test_memory import there_and_back, with_effect

SMALL = 0.02  # usual sizes


def at_a_third(setup, effect, evaluations: int):
    """Return the sensitivities of a rope fitted to its own shapes, and an effect at one place."""
    model = Equilibrium(setup, [PARAMETERS["EI"].term(setup)])
    seen = model.at(np.zeros(1)).seen
    fitted = fit(model, FitProblem(scanned(seen), Noise(), BINS), evaluations=evaluations)
    every = Hypothesis(effect, effect.scan_places(setup))
    one = Hypothesis(effect, every.places[len(every.places) // 3 :][:1])
    return Sensitivities(fitted), one


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    "effect",
    [BendingHysteresis(), PlasticSet(), ViscoelasticCreep(), FreeKink(), FreeCurvature()],
    ids=lambda effect: effect.name,
)
def test_the_derivative_at_zero_is_the_response_to_a_small_size(effect, held):
    setup = there_and_back(48)
    if held:  # by a thread
        setup = with_effect(setup, Tether(), [0.05, 0.0, 0.0, -0.003, 0.6])
    sensitivities, one = at_a_third(setup, effect, evaluations=2)
    found = sensitivities.of(one).moved[0]
    size = SMALL * one.scales(setup)
    response = sensitivities.response(one, np.concatenate([size, one.places[0]]))
    response = (response - sensitivities.point.seen) / SMALL
    assert np.linalg.norm(response) > 1e-3  # m
    assert np.linalg.norm(found - response) < 0.03 * np.linalg.norm(response)


@pytest.mark.parametrize("effect", [FreeKink(), FreeCurvature()], ids=lambda effect: effect.name)
def test_a_rope_with_memory_turns_towards_its_bends(effect, monkeypatch):
    """Without going through all frames anew for every place."""
    setup = with_effect(there_and_back(48), BendingHysteresis(), [1e-3, 1.0])
    sensitivities, one = at_a_third(setup, effect, evaluations=1)
    response = sensitivities._finite_responses(one)[0]
    monkeypatch.delattr(Sensitivities, "_finite_responses")
    found = sensitivities.of(one).moved
    assert found is not None
    assert np.linalg.norm(response) > 1e-3  # m
    assert np.linalg.norm(found[0] - response) < 0.05 * np.linalg.norm(response)


@pytest.mark.parametrize("effect", [FreeKink(), FreeCurvature()], ids=lambda effect: effect.name)
def test_a_rope_dragged_over_a_rough_table_turns_towards_its_bends(effect, monkeypatch):
    """Without settling every frame anew for every place."""
    model = Equilibrium(rough(swept(48), ROUGH), [PARAMETERS["EI"].term(swept(48))])
    seen = model.at(np.zeros(1)).seen
    fitted = fit(model, FitProblem(scanned(seen), Noise(), BINS), evaluations=1)
    every = Hypothesis(effect, effect.scan_places(fitted.point.setup))
    one = Hypothesis(effect, every.places[2 * len(every.places) // 3 :][:1])  # off the table
    sensitivities = Sensitivities(fitted)
    size = SMALL * one.scales(fitted.point.setup)
    response = sensitivities.response(one, np.concatenate([size, one.places[0]]))
    response = (response - sensitivities.point.seen) / SMALL
    monkeypatch.delattr(Sensitivities, "_finite_responses")
    found = sensitivities.of(one).moved[0]
    assert np.linalg.norm(response) > 1e-3  # m
    assert np.linalg.norm(found - response) < 0.05 * np.linalg.norm(response)


def test_sensitivities_of_nearly_the_same_motion_are_kept(monkeypatch):
    """As long as the motion differs by little of what is missed; then they are computed anew."""
    lines, data = recorded(PointMass(), [0.012, 0.36], seed=3)
    problem = FitProblem(data, Noise(marker=0.002), 40)
    nominal = fit(model(driven(24), lines, FREE), problem, None, 8, tolerance=1e-3)
    (one,) = hypotheses(nominal.point.setup, ("length_error",))
    first = Sensitivities(nominal).of(one)
    louder = fit(nominal.forward, problem.under(Noise(marker=0.004)), nominal.point.u, 1)
    computed = []

    def seen_once(self, hypothesis):
        computed.append(hypothesis)
        yield np.arange(len(self.point.seen)), self.point.seen[None]

    monkeypatch.setattr(Sensitivities, "_nodes", seen_once)
    again = Sensitivities(louder).of(one, first)
    assert not computed
    np.testing.assert_allclose(2 * again.values, first.values, rtol=1e-4)
    softer = nominal.point.u - np.array([1.0, *np.zeros(nominal.forward.size - 1)])
    other = replace(nominal, point=nominal.forward.at(softer))
    Sensitivities(other).of(one, first)
    assert computed == [one]
