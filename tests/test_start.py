"""The start of a solve: catenaries against the closed form, degenerate ends."""

import numpy as np
import pytest
from scipy.optimize import brentq

from ropefit.rod.quaternion import director
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape

DOWN = np.array([0.0, 0.0, -9.81])
NONE = np.full((2, 3), np.nan)


def shape(ends, nodes=201, length=1.0, tangents=NONE, gravity=DOWN):
    return hanging_shape(length, nodes, gravity, np.array(ends, dtype=float), np.array(tangents))


def lengths(x):
    return np.linalg.norm(np.diff(x, axis=0), axis=1)


@pytest.mark.parametrize("span", [0.05, 0.3, 0.8, 0.99])
def test_level_catenary_has_the_known_sag(span):
    a = brentq(lambda a: 2 * a * np.sinh(span / (2 * a)) - 1.0, span / 40, 50)
    x = shape([[0, 0, 0], [span, 0, 0]], nodes=2001)
    assert x[:, 2].min() == pytest.approx(-a * (np.cosh(span / (2 * a)) - 1), rel=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_ends_and_length_are_met_anywhere(seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    a = rng.normal(size=3)
    b = a + direction / np.linalg.norm(direction) * rng.uniform(0.02, 0.999)
    gravity = rng.normal(size=3)
    x = shape([a, b], nodes=400, gravity=gravity)
    assert np.allclose(x[[0, -1]], [a, b], atol=1e-9)
    assert lengths(x).sum() == pytest.approx(1.0, abs=3e-3)
    down = gravity / np.linalg.norm(gravity)
    flat = (x - a) - np.outer((x - a) @ down, down)
    assert np.linalg.matrix_rank(flat, tol=1e-6) <= 1  # it lies in the plane of gravity


@pytest.mark.parametrize("ends", [[[0, 0, 0], [0, 0, -0.5]], [[0, 0, 0], [0, 0, 0]]])
def test_ends_above_each_other_or_coincident(ends):
    x = shape(ends)
    assert np.isfinite(x).all()
    assert lengths(x).sum() == pytest.approx(1.0, abs=0.02)


def test_taut_rope_is_straight():
    x = shape([[0, 0, 0], [1, 0, 0]], nodes=11)
    assert np.allclose(x[:, 1:], 0)
    assert np.allclose(lengths(x), 0.1)


def test_no_gravity_still_gives_a_start():
    assert np.isfinite(shape([[0, 0, 0], [0.5, 0, 0]], gravity=np.zeros(3))).all()


def test_free_end_runs_along_the_clamp_or_down():
    up = [[0, 0, 1], [np.nan] * 3]
    x = shape([[0, 0, 0], [np.nan] * 3], nodes=5, tangents=up)
    assert np.allclose(x[-1], [0, 0, 1])
    x = shape([[np.nan] * 3, [0, 0, 0]], nodes=5)
    assert np.allclose(x[0], [0, 0, -1])


def test_two_free_ends_are_refused():
    with pytest.raises(ValueError, match="two free ends"):
        shape(NONE)


def test_frames_hold_the_tangents_and_the_clamp():
    x = shape([[0, 0, 0], [0.5, 0, 0]], nodes=15)
    clamp = np.array([0.0, 1.0, 0.0, 0.0])
    q = frames_along(x, clamp)
    assert np.allclose(np.abs(q[0]), clamp)
    edges = x[1:] - x[:-1]
    tangents = edges / np.linalg.norm(edges, axis=-1, keepdims=True)
    assert np.allclose(director(q)[1:], tangents[1:], atol=1e-9)
