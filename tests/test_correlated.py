"""What another run knows of values that hang together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.adapters.frozen import covariance_of
from ropefit.diagnosis.latent_force import LatentForce
from ropefit.models.correlated import correlated
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from tests.concealed import rope

NAMES = ["curvature_1_at_25", "curvature_1_at_50", "curvature_2_at_0"]
SD = np.array([2.0, 1.0, 0.5])
TOGETHER = np.array([[1.0, -0.99, 0.0], [-0.99, 1.0, 0.1], [0.0, 0.1, 1.0]])
START = np.array([0.3, -0.2, 0.1])


def term_of(setup):
    terms = [PARAMETERS[name].term(setup, float(START[k])) for k, name in enumerate(NAMES)]
    return terms, correlated("rest_curve", terms, TOGETHER * np.outer(SD, SD))


def test_the_search_variables_are_independent_and_as_wide_as_their_prior():
    setup = rope(24)
    terms, one = term_of(setup)
    u = np.array([0.4, -1.3, 0.7])
    assert one.search(one.value(u)) == pytest.approx(u)
    assert one.value(np.zeros(3)) == pytest.approx(START)
    drawn = np.array([one.value(v) for v in np.random.default_rng(0).normal(size=(20000, 3))])
    assert np.cov(drawn.T) == pytest.approx(TOGETHER * np.outer(SD, SD), abs=0.1)
    forward = Equilibrium(setup, [one])
    assert forward.prior().sd == pytest.approx(np.ones(3))
    low, high = forward.bounds()
    assert (low < -9).all()
    assert (high > 9).all()
    low, high = one.interval(u, np.eye(3), 1.96)
    assert high - low == pytest.approx(2 * 1.96 * SD)
    assert 0.5 * (low + high) == pytest.approx(one.value(u))
    # It does to the rope what its terms do one after another.
    apart = setup
    for term, value in zip(terms, one.value(u), strict=True):
        apart = term.apply(apart, np.array([value]))
    together = one.apply(setup, one.value(u))
    assert np.allclose(together.properties.curvature, apart.properties.curvature)


def test_what_a_run_knows_of_them():
    parameters = {
        name: SimpleNamespace(ci95=(v - 1.959964 * s, v + 1.959964 * s))
        for name, v, s in zip(NAMES, START, SD, strict=True)
    }
    correlation = np.eye(4)
    correlation[1:, 1:] = TOGETHER
    correlation[1, 3] = correlation[3, 1] = np.nan  # of what the data do not determine
    group = SimpleNamespace(
        parameters=parameters, free_names=["EI", *NAMES], correlation=correlation
    )
    found = covariance_of(group, NAMES[::-1])  # pyright: ignore[reportArgumentType]
    wanted = TOGETHER * np.outer(SD, SD)
    assert found == pytest.approx(wanted[::-1, ::-1])


def test_noise_is_not_smaller_than_it_was_measured():
    """Of markers that move in a plane nothing is left across it, whatever is left in it."""
    modes = np.eye(20)[:, :10]
    latent = LatentForce(np.empty(0), np.empty(0), np.empty(0), 0, 0, modes, np.ones(10))
    inside = np.concatenate([np.ones(10), np.zeros(10)])[:, None]
    assert latent.at(inside, 1.0) == pytest.approx(0.25 * 10 - 5 * np.log(2))
    loud = np.concatenate([2 * np.ones(10), 2 * np.ones(10)])[:, None]
    assert latent.at(loud, 1.0) == pytest.approx(latent.at(inside, 1.0))


def test_a_value_at_its_bound_does_not_lead_the_others_beyond():
    """A place at the rope's end, known together with a mass: no mass goes with a place behind it.
    The value that is nearest to a bound has a search variable of its own."""
    setup = rope(24)
    terms, _ = term_of(setup)
    low, high = np.array([-9.0, -3.0, -9.0]), np.array([9.0, 3.0, START[2]])
    one = correlated("rest", terms, TOGETHER * np.outer(SD, SD), bounds=(low, high))
    assert one.root @ one.root.T == pytest.approx(TOGETHER * np.outer(SD, SD), rel=1e-3, abs=1e-6)
    least, most = Equilibrium(setup, [one]).bounds()
    assert most == pytest.approx([30.0, 30.0, 0.0], abs=1e-6)
    assert least == pytest.approx([-9.1 / SD[2] if k == 2 else -30.0 for k in range(3)])
    beyond = one.value(np.array([1.0, -2.0, 0.0]))
    assert beyond[2] == pytest.approx(START[2])
    u = np.array([0.4, -1.3, -0.7])
    assert one.search(one.value(u)) == pytest.approx(u)
