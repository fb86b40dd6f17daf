"""A rope that yields next to its clamps only, where it bends many times as much as elsewhere."""

import numpy as np

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.scan import Projection, Scorer
from ropefit.diagnosis.sensitivities import Sensitivities
from ropefit.effects import PlasticSet
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.setup import Setup
from tests.concealed import BINS, EI, recorded, rope

TO_AND_FRO = np.array([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0, 1, 2, 3])


def clamped(segments: int) -> Setup:
    """A rope between horizontal clamps, moved to and fro."""
    setup = rope(segments)
    along = np.stack([quaternion_along(np.array([x, 0.0, 0.0])) for x in (-1, 1)])
    clamp = np.tile(along, (len(setup.ends), 1, 1))
    return setup._replace(clamp=clamp, clamped=(True, True)).frames(TO_AND_FRO)._replace(past=None)


def test_the_scan_tries_curvatures_that_only_clamps_cause():
    truth = PlasticSet().apply(clamped(288), np.array([0.8, 14.0]))
    setup = clamped(144)
    model = Equilibrium(setup, [PARAMETERS["EI"].within(Range(EI, 0.1 * EI, 10 * EI))])
    nominal = fit(model, FitProblem(recorded(truth, seed=7), Noise(white=(1e-3, 1e-3)), BINS))
    effect = PlasticSet()
    assert effect.possible(nominal.point.setup)
    hypothesis = Hypothesis(effect, effect.scan_places(nominal.point.setup))
    project = Projection(nominal)
    scorer = Scorer(
        Sensitivities(nominal).of(hypothesis), project, hypothesis.scales(nominal.point.setup)
    )
    found = scorer(project.z)
    assert found.log_factor > 10
    assert hypothesis.places[found.best, 0] > 10
