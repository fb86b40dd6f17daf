"""Hypotheses beyond the leaders of a scan, where much is missed and its order tells little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from ropefit.diagnosis.candidates import MOST_LEADERS, fit_candidates
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.effects import DistributedLoad, IntrinsicCurvature
from tests.concealed import recorded, rope
from tests.test_calm import fitted

CURVED, LOAD = (0.0, 3.0, 0.55, 0.7), (0.03, 0.04, 0.0)


@pytest.fixture(scope="module")
def curved():
    """The nominal fit to a rope that is curved and loaded, and its scan with the curvature last of
    the hypotheses that rank high."""
    setup = rope(144)
    for effect, values in ((IntrinsicCurvature(), CURVED), (DistributedLoad(), LOAD)):
        setup = effect.apply(setup, torch.tensor(values, dtype=torch.float64))
    nominal = fitted(recorded(setup, seed=31))
    scores = Scan(nominal, sensitivities(nominal, [])).scores
    high = scores[0].log_factor
    of = {s.hypothesis.name: s for s in scores}
    others = [s for s in scores if s.hypothesis.name in OTHERS]
    ranked = [replace(s, log_factor=high) for s in others]
    return nominal, ranked, of["intrinsic_curvature"], high


OTHERS = ("point_mass", "mass_section", "kink", "soft_section", "scale_error", "end_offset")


def test_a_further_one_is_fitted_where_the_leaders_miss_much(curved):
    nominal, ranked, curvature, high = curved
    assert len(ranked) >= MOST_LEADERS
    found = fit_candidates(
        nominal, [*ranked, replace(curvature, log_factor=0.6 * high)], [], [], 6.0
    )
    first = found[0]
    assert first.hypothesis.name == "intrinsic_curvature"
    values = first.values()
    assert np.hypot(*values[:2]) == pytest.approx(CURVED[1], rel=0.2)
    assert values[2] == pytest.approx(CURVED[2], abs=0.05)


def test_one_that_ranks_low_is_not(curved):
    nominal, ranked, curvature, high = curved
    low = replace(curvature, log_factor=0.4 * high)
    found = fit_candidates(nominal, [*ranked, low], [], [], 6.0)
    assert "intrinsic_curvature" not in {c.hypothesis.name for c in found}
