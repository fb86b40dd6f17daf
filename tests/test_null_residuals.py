"""Simulated clean recordings, from which the threshold of evidence comes."""

from dataclasses import replace

import numpy as np
import pytest

from ropefit.diagnosis.scan import Projection, null_residuals
from tests.concealed import nominal_fit, recorded, rope


@pytest.fixture(scope="module")
def nominal():
    return nominal_fit(recorded(rope(144), seed=7), 72)


def test_an_error_of_the_set_up_at_its_bound_makes_no_evidence(nominal):
    """Of the simulated recordings that error is in none: no fit allows for it there."""
    held = np.flatnonzero(nominal.prior.held)
    seen = np.linalg.norm(nominal.jacobian[:, held], axis=0) * nominal.prior.sd[held]
    k = held[np.argmax(seen)]
    assert seen.max() > 5
    u = nominal.point.u.copy()
    u[k] = nominal.forward.bounds()[1][k]
    bound = replace(nominal, point=replace(nominal.point, u=u))
    along = nominal.jacobian[:, k] / np.linalg.norm(nominal.jacobian[:, k])
    for one in (nominal, bound):
        null = null_residuals(one, Projection(one), 200, np.random.default_rng(0))
        assert (along @ null).std() < 1.2
