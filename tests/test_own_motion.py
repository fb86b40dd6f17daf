"""Inertia is fitted to the motion of the model, where that observed has errors of its own."""

import numpy as np
import pytest

from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.own_motion import with_own_motion
from ropefit.effects import Inertia
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.models.rates import rates
from ropefit.rod.setup import Motion, Setup
from tests.concealed import BINS, recorded, rope

FRAMES, STEP = 48, 0.12  # s
WHOLE = Inertia().apply


def moved(setup: Setup, x: np.ndarray) -> Setup:
    """The rope with the motion of nodes (F, N+1, 3)."""
    return setup._replace(motion=Motion(*rates(setup.clock, x, [np.arange(len(x))])))


def in_motion(segments: int) -> Setup:
    """The rope that sweeps, in balance with its own inertia."""
    setup = rope(segments, FRAMES)._replace(time=STEP * np.arange(FRAMES))
    still = setup
    for _ in range(6):
        setup = moved(still, Equilibrium(setup, []).at(np.empty(0)).seen)
        setup = WHOLE(setup, np.ones(1))
    return setup


def fitted(error: float) -> Fit:
    """The inertia as fitted to accelerations with errors of that share."""
    data = recorded(in_motion(144), seed=5, sd=5e-4)
    setup = in_motion(72)._replace(load=rope(72).load)
    motion, rng = setup.motion, np.random.default_rng(6)
    assert motion is not None
    # Alike along the rope, as where a line is drawn through an end that is elsewhere.
    usual = np.sqrt((motion.acceleration**2).mean())
    off = motion.acceleration + error * usual * rng.normal(size=(FRAMES, 1, 3))
    setup = setup._replace(motion=Motion(motion.velocity, off))
    terms = [PARAMETERS["EI"].within(Range(5e-4, 5e-8, 5.0))]
    forward = Equilibrium(setup, [*terms, *calibration(setup, Priors(), False)])
    nominal = fit(forward, FitProblem(data, Noise(), BINS))
    found = fit_candidate(nominal, Hypothesis(Inertia(), NO_PLACE), np.ones(1))
    assert found is not None
    return found.fit


def share_of(found: Fit) -> tuple[float, float]:
    """The share of the inertia, and its standard error."""
    value = found.forward.terms[-1].value(found.point.u[-1:])
    return float(value[0]), float(found.sd()[-1] * found.forward.terms[-1].scale[0])


def test_a_share_that_errors_of_the_acceleration_dilute_is_made_whole():
    before = fitted(0.6)
    after = with_own_motion(before)
    diluted, (share, sd) = share_of(before)[0], share_of(after)
    assert diluted < 0.85
    assert share == pytest.approx(1.0, abs=max(3 * sd, 0.04))
    assert after.cost < before.cost


def test_exact_accelerations_stay_nearly_what_they_are():
    before = fitted(0.0)
    assert share_of(with_own_motion(before))[0] == pytest.approx(share_of(before)[0], abs=0.03)


def test_a_rope_on_which_nothing_acts_by_its_motion_is_returned_as_it_is():
    before = fitted(0.0)
    none = before.forward.with_terms(before.forward.terms[:-1], before.point.solution)
    still = fit(none, before.problem, before.point.u[:-1])
    assert with_own_motion(still) is still
