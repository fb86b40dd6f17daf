"""A table that a rope lies on in most frames: its rigidity is told by the others."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.calm import calm, distorted
from ropefit.diagnosis.inlier_frames import on_inlier_frames
from ropefit.effects import PointMass, SupportPlane
from ropefit.inference.least_squares import Fit
from ropefit.models.equilibrium import Equilibrium
from tests.concealed import EI, nominal_fit, recorded, rope, with_effect


def rigidity(fitted: Fit) -> float:
    """Return the EI [N m²] of a fit."""
    return float(fitted.point.setup.properties.bend[0])


def test_the_frames_that_hang_free_tell_the_rope_where_most_lie_on_a_table():
    free = rope(288, frames=16)
    hangs = Equilibrium(free, []).at(np.empty(0)).seen[..., 2].min(axis=1)
    middle = free.ends[..., 2].mean(axis=(0, 1))
    level = float(np.sort(hangs)[11] - middle)  # four frames stay above
    there = SupportPlane().apply(free, np.array([level, 0.0, 0.0]))
    nominal = nominal_fit(recorded(there, seed=4))
    assert distorted(nominal)
    assert abs(np.log(rigidity(nominal) / EI)) > 1
    inliers = on_inlier_frames(nominal)
    assert inliers is not None
    assert not distorted(inliers)
    assert abs(np.log(rigidity(inliers) / EI)) < 0.2
    assert calm(nominal).point.u == pytest.approx(inliers.point.u, abs=1e-4)


def test_no_frames_are_inliers_where_all_have_the_same_cause():
    heavy = with_effect(PointMass(), [0.04, 0.45])
    nominal = nominal_fit(recorded(heavy, seed=5))
    assert distorted(nominal)
    assert on_inlier_frames(nominal) is None
