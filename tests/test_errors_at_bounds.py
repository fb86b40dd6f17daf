"""An error of the set-up that is at its bound, thirty times what is usual, is looked at as an
effect, although a scan sees nothing beside it."""

import numpy as np
import pytest

from ropefit.diagnosis.candidate import fit_candidate
from ropefit.diagnosis.proposals import proposals, proposals_beside
from ropefit.effects import DistributedLoad, GravityMisalignment
from ropefit.inference.least_squares import inside
from ropefit.models.priors import DEGREE, Priors
from tests.concealed import nominal_fit, recorded, rope

BOUND = 30 * Priors().gravity * DEGREE
TILT = np.array([0.0, 1.02 * BOUND])  # rad: its bound leaves next to nothing


def proposed(tilt: np.ndarray):
    """The nominal fit to a rope under gravity so turned, and what is proposed for it."""
    nominal = nominal_fit(recorded(GravityMisalignment().apply(rope(288), tilt), seed=4))
    starts = proposals(nominal, slow=False, names=("gravity_misalignment",))
    return nominal, [values for ((_, values),) in starts]


def test_gravity_at_its_bound_is_proposed_and_found():
    nominal, values = proposed(TILT)
    assert not inside(nominal).all()
    assert len(values) == 1
    assert np.abs(values[0]).max() == pytest.approx(BOUND, rel=1e-3)
    ((hypothesis, start),) = proposals(nominal, slow=False, names=("gravity_misalignment",))[0]
    found = fit_candidate(nominal, hypothesis, start)
    assert found is not None
    assert found.evidence > 300  # nats: what thirty standard errors of the prior cost
    np.testing.assert_allclose(found.values(), TILT, atol=4 * found.sd().max())


def test_an_error_within_its_bounds_is_left_to_the_scan():
    assert proposed(0.5 * TILT)[1] == []


def test_a_load_that_pulls_as_another_gravity_does_is_proposed_beside_it():
    nominal, _ = proposed(0.5 * TILT)
    starts = proposals_beside(GravityMisalignment(), TILT, nominal, ("distributed_load",))
    (((_, load),),) = starts
    setup = nominal.forward.base
    turned = GravityMisalignment().apply(setup, TILT).rod().load
    same = DistributedLoad().apply(setup, load).rod().load
    np.testing.assert_allclose(same, turned, atol=1e-9)
