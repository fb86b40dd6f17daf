"""Planes and bars are looked for where the rope is, not where a camera that is off sees it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ropefit.effects import SupportPlane
from ropefit.effects.place import middle_of
from ropefit.inference.diagnosis.contact import proposals
from ropefit.inference.diagnosis.weigh import fit_rival
from ropefit.inference.forward import Forward
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.terms import shift_camera
from tests.concealed import BINS, nominal_fit, recorded, rope

DEPTH = 0.002  # m by which the rope would sink into the table in the less low of two frames


@pytest.mark.parametrize("higher", [-0.004, 0.0, 0.004])
def test_a_table_is_found_although_the_camera_is_off(higher):
    free = rope(288)
    lowest = np.sort(Forward(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[1] + DEPTH - float(middle_of(free)[2])
    table = SupportPlane().apply(free, torch.tensor([height, 0.0, 0.0], dtype=torch.float64))
    off = torch.tensor([0.0, 0.0, higher], dtype=torch.float64)
    data = recorded(shift_camera(table, off), seed=8)
    nominal = nominal_fit(data)
    data = data.settled(nominal.point.seen)
    nominal = fit(nominal.forward, data, Noise(), BINS, nominal.point.u)
    ((family, start),) = next(p for p in proposals(nominal) if p[0][0].name == "support_plane")
    assert start[0] == pytest.approx(height, abs=0.0015)
    rival = fit_rival(nominal, family, start, data, Noise(), BINS)
    assert rival is not None
    assert rival.evidence > 30
    assert rival.values()[0] == pytest.approx(height, abs=0.001)
