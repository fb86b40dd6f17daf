"""Two weights on one rope: found together, where each alone is somewhere else."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ropefit.diagnosis.pairs import best_pair
from ropefit.diagnosis.search import sensitivities
from ropefit.effects import PointMass
from tests.concealed import recorded, rope, with_effect
from tests.test_calm import fitted

WEIGHTS = ((0.003, 0.31), (0.004, 0.66))


def test_two_weights_are_found_together():
    setup = rope(288)
    for weight in WEIGHTS:
        setup = PointMass().apply(setup, torch.tensor(weight, dtype=torch.float64))
    nominal = fitted(recorded(setup, seed=103))
    found = best_pair(nominal, sensitivities(nominal, [], ("point_mass", "kink")), None, 6.0)
    assert found is not None
    pair, both = found
    for (candidate, without), weight in zip(pair, WEIGHTS, strict=True):
        assert candidate.hypothesis.name == "point_mass"
        low, high = candidate.interval(3.0)
        assert (low <= weight).all()
        assert (weight <= high).all()
        assert candidate.values()[0] == pytest.approx(weight[0], rel=0.15)
        assert candidate.values()[1] == pytest.approx(weight[1], abs=0.02)
        assert candidate.evidence > 20
        assert without.cost > both.cost + 40


def test_one_weight_is_no_pair():
    nominal = fitted(recorded(with_effect(PointMass(), [0.004, 0.5]), seed=104))
    known = sensitivities(nominal, [], ("point_mass",))
    assert best_pair(nominal, known, None, 6.0) is None
    assert np.isfinite(nominal.cost)
