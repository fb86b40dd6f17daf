"""What is known of search variables beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ropefit.inference.steps import with_priors
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.models.prior import Joint, Prior
from tests.concealed import rope

COVARIANCE = np.array([[1.0, -0.9, 0.2], [-0.9, 4.0, 0.1], [0.2, 0.1, 0.25]])


def test_each_by_itself():
    prior = Prior(np.array([0.5, np.inf, 2.0]))
    assert prior.held.tolist() == [True, False, True]
    np.testing.assert_allclose(prior.factor, [[2, 0, 0], [0, 0, 0.5]])
    np.testing.assert_allclose(prior.information, np.diag([4, 0, 0.25]))
    np.testing.assert_allclose(prior.rows(np.array([1.0, 7.0, 3.0])), [2.0, 1.5])
    broad = prior.with_broad(np.array([np.inf, 3.0, 1.0]))
    np.testing.assert_allclose(broad.sd, [0.5, 3.0, 1.0])
    drawn = prior.drawn(20_000, np.random.default_rng(0))
    np.testing.assert_allclose(drawn.std(axis=1), [0.5, 0, 2], rtol=0.03)
    np.testing.assert_allclose(with_priors(np.ones((1, 3)), prior)[1:], prior.factor)


@given(
    st.lists(st.floats(1e-6, 1e6), min_size=3, max_size=3),
    st.lists(st.floats(-3, 3), min_size=5, max_size=5),
)
def test_some_together(sizes, u):
    """Whatever their units, and whatever stands between them."""
    mine, scale = np.array([0, 3, 4]), np.array(sizes)
    covariance = COVARIANCE * np.outer(scale, scale)
    sd = np.array([0.0, 2.0, np.inf, 0.0, 0.0])
    sd[mine] = np.sqrt(np.diag(covariance))
    prior, at = Prior(sd, ((mine, covariance),)), np.array(u)
    at[mine] *= scale
    standard = at[mine] / scale
    wanted = standard @ np.linalg.solve(COVARIANCE, standard) + (at[1] / 2) ** 2
    assert prior.rows(at) @ prior.rows(at) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert at @ prior.information @ at == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    drawn = prior.drawn(4000, np.random.default_rng(1))[mine] / scale[:, None]
    np.testing.assert_allclose(np.cov(drawn), COVARIANCE, atol=0.25)


def test_terms_that_are_known_together_may_be_apart_or_missing():
    setup, joint = rope(24), Joint(COVARIANCE)
    sd = np.sqrt(np.diag(COVARIANCE))
    one, two, three = (
        replace(PARAMETERS[name].term(setup), prior=sd[k : k + 1], joint=(joint, k))
        for k, name in enumerate(("EI", "GJ", "EA"))
    )
    between = PARAMETERS["curvature_1"].term(setup)
    prior = Equilibrium(setup, [three, between, one, two]).prior()
    assert prior.held.tolist() == [True, False, True, True]
    told = np.linalg.inv(prior.information[np.ix_([2, 3, 0], [2, 3, 0])])
    np.testing.assert_allclose(told, COVARIANCE, rtol=1e-9)
    few = Equilibrium(setup, [two, between, one]).prior()  # of which the third says nothing
    told = np.linalg.inv(few.information[np.ix_([2, 0], [2, 0])])
    np.testing.assert_allclose(told, COVARIANCE[:2, :2], rtol=1e-9)
