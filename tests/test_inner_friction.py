"""Friction inside the reference rope: balance of moments, derivatives, and Dahl's loop in closed
form."""

from __future__ import annotations

import numpy as np
import pytest

from reference_simulators.inner_friction import dahl, prandtl, strained

OWN, MORE, SLIP = 2e-3, 3e-3, 1.3  # N m², N m², 1/m


@pytest.fixture(scope="module")
def drawn():
    rng = np.random.default_rng(0)
    held = rng.normal(size=(60, 2))
    held *= SLIP * rng.uniform(0, 0.95, (60, 1)) / np.linalg.norm(held, axis=1, keepdims=True)
    return 8e-3 * rng.normal(size=(60, 2)), held


def test_moments_balance_and_derivatives_are_exact(drawn):
    left, held = drawn
    own = np.full((60, 1), OWN)

    def slipping(m):
        return prandtl(m, own, MORE, SLIP)

    def dahls(m):
        return dahl(m, own, MORE, SLIP, held)

    d = dahls(left)[0]
    np.testing.assert_allclose(OWN * d + MORE * strained(d, SLIP, held), left, atol=1e-15)
    d = slipping(left)[0]
    size = np.linalg.norm(d, axis=1, keepdims=True)
    np.testing.assert_allclose(OWN * d + MORE * np.minimum(1, SLIP / size) * d, left, atol=1e-15)
    for law in (slipping, dahls):
        slope = law(left)[1]
        for axis in range(2):
            step = 1e-8 * np.eye(2)[axis]
            rise = (law(left + step)[0] - law(left - step)[0]) / 2e-8
            np.testing.assert_allclose(slope[..., axis], rise, rtol=1e-4, atol=1e-3)


def test_a_loop_to_and_fro_is_dahls():
    """At the ends of a loop of turns ± A the moment is MORE SLIP tanh(A / SLIP)."""
    turn, held = 2.0, np.zeros((1, 2))
    for way in (-1, 1) * 20:
        held = strained(np.array([[way * 2 * turn, 0.0]]), SLIP, held)
    assert held[0, 0] == pytest.approx(SLIP * np.tanh(turn / SLIP), rel=1e-12)


def test_a_way_in_parts_is_the_whole_way(drawn):
    d, held = drawn[0] / OWN, drawn[1]
    halfway = strained(0.3 * d, SLIP, held)
    np.testing.assert_allclose(strained(0.7 * d, SLIP, halfway), strained(d, SLIP, held))
