"""What is only explored is computed on fewer segments, corrected at the fit itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.calm import calm
from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.few_frames import on_few_frames
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import PointMass
from ropefit.inference.least_squares import Fit, fit
from ropefit.models.equilibrium import Equilibrium
from ropefit.solvers.equilibrium.solution import at_nodes_of
from tests.concealed import nominal_fit, recorded, rope

FINE, COARSE, FRAMES = 144, 72, 20
MASS = np.array([0.002, 0.37])


def with_coarser(fitted: Fit) -> Fit:
    """Return a fit under the noise that its own match shows, of a model with a coarser mesh."""
    coarser = rope(COARSE, len(fitted.point.seen), bend=3e-4)
    problem = fitted.problem.settled(fitted.point.seen)
    white = tuple(float(v) for v in problem.match(fitted.point.seen).scatter[0])
    problem = problem.under(replace(problem.noise, white=white))
    forward = replace(fitted.forward, coarser=coarser, last=fitted.point.solution)
    return fit(forward, problem, fitted.point.u, 5, tolerance=1e-5)


@pytest.fixture(scope="module")
def nominal() -> Fit:
    weighted = PointMass().apply(rope(288, FRAMES), MASS)
    return with_coarser(nominal_fit(recorded(weighted, seed=5)))


def test_the_fit_itself_is_the_same_on_a_coarse_mesh(nominal: Fit):
    coarse = on_coarse_mesh(nominal)
    assert coarse.forward.base.segments == COARSE
    np.testing.assert_array_equal(coarse.point.u, nominal.point.u)
    here = at_nodes_of(COARSE, nominal.point.seen)
    np.testing.assert_allclose(coarse.point.seen, here, atol=1e-6)
    assert coarse.cost == pytest.approx(nominal.cost, rel=1e-3)
    assert np.abs(coarse.point.solution.x - here).max() > 1e-5  # of that mesh alone
    assert on_coarse_mesh(nominal) is coarse
    assert calm(coarse).forward.base.segments == COARSE


def test_an_effect_explains_there_what_it_explains(nominal: Fit):
    fine, coarse = (
        fit_candidate(fitted, Hypothesis(PointMass(), NO_PLACE), MASS)
        for fitted in (nominal, on_coarse_mesh(nominal))
    )
    assert fine is not None
    assert coarse is not None
    assert fine.evidence > 100
    assert coarse.evidence == pytest.approx(fine.evidence, rel=0.02)
    np.testing.assert_allclose(coarse.values(), fine.values(), rtol=0.01)


def test_few_frames_are_of_the_coarse_mesh(nominal: Fit):
    few = on_few_frames(nominal)
    assert few is not None
    assert few.forward.base.segments == COARSE
    assert on_coarse_mesh(few) is few


def test_a_fit_without_a_coarser_mesh_stays_as_it_is():
    plain = nominal_fit(recorded(rope(FINE), seed=3), COARSE)
    assert on_coarse_mesh(plain) is plain


def test_a_fit_that_does_not_settle_there_stays_as_it_is(nominal: Fit):
    fitted = with_coarser(nominal)
    assert isinstance(fitted.forward, Equilibrium)
    assert fitted.forward.coarser is not None
    lost = np.full_like(fitted.forward.coarser.gravity, np.nan)
    fitted.forward.coarser = fitted.forward.coarser._replace(gravity=lost)
    assert on_coarse_mesh(fitted) is fitted


def test_states_keep_their_shape_on_another_mesh():
    states = Equilibrium(rope(FINE), []).at(np.empty(0)).solution.states
    flipped = replace(states, q=states.q * np.where(np.arange(FINE) % 3 == 0, -1.0, 1.0)[:, None])
    for one in (states, flipped):
        other = one.of_segments(COARSE)
        assert other.q.shape == (len(one.q), COARSE, 4)
        np.testing.assert_allclose(np.linalg.norm(other.q, axis=-1), 1, atol=1e-12)
        np.testing.assert_allclose(other.x, states.x[:, ::2], atol=1e-12)
        middle = 0.5 * (states.q[:, 2:-2:2] + states.q[:, 3:-1:2])
        same = np.abs((other.q[:, 1:-1] * middle).sum(-1))
        np.testing.assert_allclose(same, 1, atol=1e-3)
    assert states.of_segments(FINE) is states
