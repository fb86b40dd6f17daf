"""Fits to few frames, and first-order moves: cheap stand-ins for fits to all frames."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.beginning import first_order_move
from ropefit.diagnosis.candidate import cost_for, fit_candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.few_frames import FEW_FRAMES, on_few_frames
from ropefit.diagnosis.fits import Fits
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.noise_measurement import end_noise
from ropefit.effects import HalfSpace, MassSection, PointMass
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import covariances
from tests.concealed import nominal_fit, recorded, rope, with_effect

MASS = np.array([0.0006, 0.37])


@pytest.fixture(scope="module")
def nominal() -> Fit:
    return nominal_fit(recorded(with_effect(PointMass(), list(MASS), 144), seed=7), 72)


def repeated(nominal: Fit, times: int) -> Fit:
    """Return the fit of a recording that holds every pose several times."""
    index = np.repeat(np.arange(len(nominal.point.seen)), times)
    forward = nominal.forward.of_setup(
        nominal.forward.base.frames(index), None, nominal.forward.terms
    )
    return fit(forward, nominal.problem.frames(index), nominal.point.u, 5, tolerance=1e-6)


def test_few_frames_of_a_recording_tell_nearly_the_same(nominal: Fit):
    many = repeated(nominal, 2)
    few = on_few_frames(many)
    assert few is not None
    assert len(few.point.seen) == FEW_FRAMES < len(many.point.seen)
    assert few.point.converged.all()
    assert len(few.z) < 0.5 * len(many.z)
    # Of what all frames tell, to within their standard errors.
    assert (np.abs(few.point.u - many.point.u) < 4 * few.sd()).all()
    assert few.sd()[0] > many.sd()[0]  # of EI; calibration errors have priors


def test_a_short_recording_stays_whole(nominal: Fit):
    assert len(nominal.point.seen) < FEW_FRAMES / 0.6
    assert on_few_frames(nominal) is None


def test_noise_of_the_ends_goes_with_its_frames(nominal: Fit):
    ends = replace(end_noise(nominal), sd=(2e-4, 0.0))
    problem = nominal.problem.under(replace(nominal.problem.noise, ends=ends))
    index = np.array([1, 4, 5, 9])
    few = problem.frames(index)
    rows, mine = nominal.stations.among(index)
    whole = dense(nominal.stations, problem.noise)
    part = dense(mine, few.noise)
    at = (rows[:, None] * 2 + np.arange(2)).ravel()
    np.testing.assert_allclose(part, whole[np.ix_(at, at)], rtol=1e-9, atol=1e-15)


def dense(stations, noise) -> np.ndarray:
    """Return (M D, M D) the covariance [m²] of all stations."""
    size = stations.residual.size
    out = np.zeros((size, size))
    for rows, covariance in covariances(stations, noise):
        for mine, block in zip(rows, covariance, strict=True):
            out[np.ix_(mine, mine)] = block
    return out


def test_a_first_order_move_is_what_a_fit_moves(nominal: Fit):
    hypothesis = Hypothesis(PointMass(), np.array([]))
    fitted = fit_candidate(nominal, hypothesis, MASS)
    assert fitted is not None
    moved = first_order_move(nominal, hypothesis, 0.3 * MASS * [1, 1 / 0.3])
    assert moved is not None
    # Beside the nominal model's own values and their priors, it explains as much as the fit does.
    weights = np.diag(np.where(nominal.prior.held, 1 / nominal.prior.sd, 0.0))
    slopes = np.concatenate([nominal.jacobian, -weights])
    rows = np.concatenate(
        [nominal.whitener(nominal.stations.residual - moved), weights @ nominal.point.u]
    )
    left = rows - slopes @ np.linalg.lstsq(slopes, rows, rcond=None)[0]
    assert nominal.cost - left @ left == pytest.approx(nominal.cost - fitted.fit.cost, rel=0.1)
    assert fitted.fit.cost < 0.6 * nominal.cost


def test_what_may_tie_with_the_best_candidate_is_not_stopped(nominal: Fit):
    """However much what the smaller model misses scales evidence down: the best leaves noise."""
    fits = Fits(nominal, 6.0)
    fits.add([(Hypothesis(PointMass(), NO_PLACE), MASS)])
    best = fits.best()
    assert best is not None
    fits.current = replace(nominal, spread=50.0, cost=1.4 * best.fit.cost)
    assert cost_for(fits.current, 0.5 * best.evidence) < best.fit.cost
    needed = fits._needed(Hypothesis(MassSection(), NO_PLACE))
    assert best.fit.cost + 2 * TIE_NATS < needed < fits.current.cost


def test_a_field_that_explains_nothing_moves_nothing():
    clean = nominal_fit(recorded(rope(144), seed=3), 72)
    hypothesis = Hypothesis(HalfSpace(), np.array([]))
    assert first_order_move(clean, hypothesis, np.array([0.002, 0.05, 0.1, 0.3, -20.0])) is None
