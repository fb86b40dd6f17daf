"""Steps towards the least sum of squares, against algebra and a valley with a known end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from ropefit.inference.steps import FURTHEST_STEP, along_valley, foreseen, linear_step

WIDE = np.full(2, 10.0)
START = np.array([-1.2, 1.44])  # at the bottom of the valley
STEEP = 100.0


def valley(u: np.ndarray) -> np.ndarray:
    """Rosenbrock's function: least along a parabola, where (1, 1) is."""
    return np.array([STEEP * (u[1] - u[0] ** 2), 1 - u[0]])


def slopes(u: np.ndarray) -> np.ndarray:
    return np.array([[-2 * STEEP * u[0], STEEP], [-1.0, 0.0]])


def test_a_linear_step_is_found_where_the_normal_equations_are_singular_in_floating_point():
    """In a bad start slopes span nine orders of magnitude, and their squares eighteen."""
    rng = np.random.default_rng(3)
    turn, other = (np.linalg.qr(rng.normal(size=(n, n)))[0] for n in (28, 27))
    slopes = turn[:, :27] @ np.diag(np.geomspace(7e7, 5e-2, 27)) @ other
    rows, wide = rng.normal(size=28) * 1e3, np.full(27, 1e9)
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.cholesky(slopes.T @ slopes)
    gain = linear_step(slopes, rows, -wide, wide)[1]
    held = np.concatenate([slopes, np.eye(27) / FURTHEST_STEP])
    step = np.linalg.lstsq(held, np.concatenate([-rows, np.zeros(27)]), rcond=None)[0]
    assert gain == pytest.approx(rows @ rows - np.square(rows + slopes @ step).sum(), rel=1e-6)


def test_the_best_linear_step_within_bounds_gains():
    """Where two parameters do nearly the same, the free step cut off at a bound would lose."""
    slopes = np.array([[1.0, 1.0], [0.0, 0.1]])
    rows = np.array([-1.0, 1.0])  # freely: (11, -10)
    low, high = np.array([-20.0, -1.0]), np.array([20.0, 20.0])
    cut = rows + slopes @ np.clip([11.0, -10.0], low, high)
    assert cut @ cut > rows @ rows
    gain = linear_step(slopes, rows, low, high)[1]
    left = rows + slopes @ np.array([2.0, -1.0])  # by hand: the best one has the second at -1
    assert gain == pytest.approx(rows @ rows - left @ left, rel=1e-3)
    assert linear_step(slopes, rows, np.zeros(2), np.zeros(2))[1] == pytest.approx(0, abs=1e-12)


def test_the_end_of_a_curved_valley_is_reached_where_a_trust_region_is_still_on_its_way():
    most = 40
    jac: Any = slopes
    on_its_way = least_squares(valley, START, jac, ftol=1e-5, max_nfev=most).x
    assert foreseen(valley(on_its_way), slopes(on_its_way), on_its_way, -WIDE, WIDE) > 0.1
    evaluations = 0

    def counted(u: np.ndarray) -> np.ndarray:
        nonlocal evaluations
        evaluations += 1
        return valley(u)

    found = along_valley(counted, slopes, START, -WIDE, WIDE, 1e-4, most)
    assert evaluations <= most + 1
    assert foreseen(valley(found), slopes(found), found, -WIDE, WIDE) < 1e-4
    np.testing.assert_allclose(found, [1.0, 1.0], atol=2e-2)


def test_a_valley_is_followed_to_a_bound_and_not_beyond():
    high = np.array([0.5, 10.0])
    found = along_valley(valley, slopes, START, -WIDE, high, 1e-6, 200)
    assert found[0] <= 0.5
    np.testing.assert_allclose(found, [0.5, 0.25], atol=1e-2)


def test_a_valley_is_followed_along_a_bound():
    """The third would cross its bound, as a weight at the very tip: the others go on without it."""

    def rows(u: np.ndarray) -> np.ndarray:
        return np.array([*(valley(u) / [10, 1] + [0, 3 * u[2]]), 20 * (u[2] - 0.8 + 0.5 * u[0])])

    def slopes(u: np.ndarray) -> np.ndarray:
        return np.array([[-20 * u[0], 10.0, 0.0], [-1.0, 0.0, 3.0], [10.0, 0.0, 20.0]])

    low, high = np.full(3, -10.0), np.array([10.0, 10.0, 0.0])
    found = along_valley(rows, slopes, np.array([-1.5, 1.0, 0.0]), low, high, 1e-4, 60)
    a = 161 / 101  # by hand, with the third at zero: (1 - a)² + (10 a - 16)² is least
    np.testing.assert_allclose(found, [a, a**2, 0.0], atol=1e-3)


def test_a_step_is_not_taken_where_the_rope_would_not_settle():
    """Nor is it tried where such a place makes the second derivative enormous: that takes long."""
    furthest = 0.0

    def settled(u: np.ndarray) -> np.ndarray:
        nonlocal furthest
        furthest = max(furthest, float(np.abs(u).max()))
        return valley(u) if u[0] < 0 else np.full(2, 1e6)

    wide = np.full(2, np.inf)
    found = along_valley(settled, slopes, START, -wide, wide, 1e-6, 100)
    assert furthest < 10
    assert found[0] < 0
    assert np.sum(valley(found) ** 2) < np.sum(valley(START) ** 2)


def test_what_is_foreseen_is_counted_as_large_as_noise_makes_it():
    rows, rng = 10 * np.random.default_rng(1).normal(size=400), np.random.default_rng(2)
    slope = rng.normal(size=(400, 2))
    one, ten = (foreseen(k * rows, slope, np.zeros(2), -WIDE, WIDE) for k in (1, 10))
    assert one == pytest.approx(ten, rel=0.03)
    assert foreseen(rows, np.zeros((400, 0)), *np.zeros((3, 0))) == 0.0  # nothing is free
