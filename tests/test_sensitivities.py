"""Sensitivities at zero size of effects that change nothing smoothly there: what remembers the
frames before, and rest curvature of a rope that is free to spin."""

import numpy as np
import pytest

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import (
    BendingHysteresis,
    FreeCurvature,
    FreeKink,
    PlasticSet,
    Tether,
    ViscoelasticCreep,
)
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from tests.concealed import BINS, scanned
from tests.test_memory import there_and_back, with_effect

SMALL = 0.02  # usual sizes


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
    model = Equilibrium(setup, [PARAMETERS["EI"].term(setup)])
    seen = model.at(np.zeros(1)).seen
    fitted = fit(model, FitProblem(scanned(seen), Noise(), BINS), evaluations=2)
    every = Hypothesis(effect, effect.scan_places(setup))
    one = Hypothesis(effect, every.places[len(every.places) // 3 :][:1])
    sensitivities = Sensitivities(fitted)
    found = sensitivities.of(one).nodes[0]
    size = SMALL * one.scales(setup)
    response = sensitivities.response(one, np.concatenate([size, one.places[0]]))
    response = (response - sensitivities.point.seen) / SMALL
    assert np.linalg.norm(response) > 1e-3  # m
    assert np.linalg.norm(found - response) < 0.03 * np.linalg.norm(response)
