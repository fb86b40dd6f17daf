"""Intervals that cover, verdicts that name what the data cannot say."""

import numpy as np
import pytest
from scipy.optimize import minimize

from ropefit.inference.sandwich import cluster_estimates, sandwich

LINE = np.linspace(0, 1, 15)


def fit_line(rng, frames=20, sd=0.1, common=0.1):
    """Least sum of norms of y = a + b s in `frames` clusters with a common error each."""
    y = 1.0 + 2.0 * LINE + rng.normal(0, common, (frames, 1)) + rng.normal(0, sd, (frames, 15))
    design = np.stack([np.ones(15), LINE], axis=1)

    def loss(p):
        return np.abs(y - design @ p).sum()

    best = minimize(loss, [1.0, 2.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9})
    residual = (y - design @ best.x).reshape(-1, 1)
    jacobian = -np.tile(design, (frames, 1))[:, None, :]
    cluster = np.repeat(np.arange(frames), 15)
    return best.x, sandwich(jacobian, residual, cluster, floor=sd, dead_below=1e-12)


def test_intervals_cover_in_the_presence_of_clusters():
    rng = np.random.default_rng(0)
    truth = np.array([1.0, 2.0])
    covered = []
    for _ in range(150):
        value, found = fit_line(rng)
        covered.append(np.abs(value - truth) < found.half_width)
    share = np.mean(covered, axis=0)
    # 95 % within the scatter of 150 trials and of a covariance from 20 clusters.
    assert (share > 0.88).all()
    assert (share < 1.0).all()
    value, found = fit_line(rng)
    assert (found.half_width < 0.3).all()


def jacobian_of(columns):
    return np.stack(columns, axis=-1)[:, None, :]


def judge(columns, seed=1):
    rng = np.random.default_rng(seed)
    jacobian = jacobian_of(columns)
    residual = rng.normal(0, 0.01, (len(jacobian), 1))
    cluster = np.arange(len(jacobian)) // 10
    found = sandwich(jacobian, residual, cluster, floor=0.01, dead_below=1e-9)
    names, bounds = list("abc")[: len(columns)], (np.full(3, 1e-9), np.full(3, 1e9))
    told = cluster_estimates(found, names, np.ones(len(columns)), bounds, converged=True)
    return found, [(told.of[name].verdict, told.of[name].partners) for name in names]


@pytest.fixture
def columns():
    rng = np.random.default_rng(4)
    return [rng.normal(size=200) for _ in range(3)]


def test_independent_columns_are_determined(columns):
    found, judged = judge(columns)
    assert [name for name, _ in judged] == ["determined"] * 3
    assert found.condition < 2


def test_exact_trade_off_is_named_with_its_partner(columns):
    found, judged = judge([columns[0], -2 * columns[0], columns[1]])
    assert judged[0] == ("trade-off", ("b",))
    assert judged[1] == ("trade-off", ("a",))
    assert judged[2][0] == "determined"
    assert np.isinf(found.half_width[:2]).all()
    assert np.isinf(found.condition)


def test_column_without_effect_is_dead(columns):
    found, judged = judge([columns[0], 0 * columns[0]])
    assert [name for name, _ in judged] == ["determined", "dead"]
    assert np.isinf(found.half_width[1])


def test_weak_column_is_flat(columns):
    _, judged = judge([columns[0], 1e-5 * columns[1]])
    assert judged[1][0] == "flat direction"


def test_too_few_clusters_give_no_interval():
    rng = np.random.default_rng(2)
    jacobian = rng.normal(size=(30, 1, 3))
    found = sandwich(jacobian, rng.normal(size=(30, 1)), np.repeat([0, 1], 15), 0.1, 1e-9)
    assert np.isinf(found.half_width).all()
