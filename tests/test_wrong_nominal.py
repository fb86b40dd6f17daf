"""A rope that its nominal model does not describe: intervals carry what that model misses."""

import numpy as np

import ropefit
from benchmarks.accuracy.wrong_nominal import FREE, drawn, recorded, weighed

SEED = 101


def test_a_weight_is_within_an_interval_that_says_something(tmp_path):
    pair = drawn(np.random.default_rng(SEED))
    without, with_weight = (
        ropefit.preprocess(recorded(pair, weights, tmp_path / name, 2 * SEED + k))
        for k, (name, weights) in enumerate((("without", ()), ("with", (pair.weight,))))
    )
    source = ropefit.fit(without, free=FREE)
    found = weighed(with_weight, source)
    assert found is not None
    truth = np.array([pair.weight[1], pair.weight[0] * pair.cable.length])
    off, fitted = np.abs(found.values() - truth), found.fit
    assert fitted.misses
    assert (off < fitted.quantile * found.sd()).all()
    assert found.sd()[0] < 0.5 * truth[0]  # and says something
