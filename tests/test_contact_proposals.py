"""Planes and bars are looked for where the rope is, not where a camera that is off sees it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from ropefit.effects import Obstacle, SupportPlane
from ropefit.effects.place import horizontal, middle_of
from ropefit.inference.diagnosis.contact import bars_under, proposals
from ropefit.inference.diagnosis.weigh import fit_rival
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward
from ropefit.models.priors import shift_camera
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


def test_bars_are_tried_where_a_slope_bears_the_rope():
    free, slopes = rope(288), np.array([0.1, -0.05])
    lowest = np.sort(Forward(free, []).at(np.empty(0)).seen[..., 2].min(axis=1))
    height = lowest[1] + DEPTH - float(middle_of(free)[2])
    values = torch.tensor([height, *slopes], dtype=torch.float64)
    point = Forward(SupportPlane().apply(free, values), []).at(np.empty(0))
    starts = bars_under(SimpleNamespace(point=point), height, slopes)  # pyright: ignore[reportArgumentType]
    first, second = (axis.numpy() for axis in horizontal(free.gravity))
    normal = np.array([0.0, 0.0, 1.0]) - slopes[0] * first - slopes[1] * second
    normal /= np.linalg.norm(normal)
    nodes = point.seen - middle_of(free).numpy()
    radii = []
    for ((family, at),) in starts:
        assert isinstance(family.effect, Obstacle)
        top = at[:3] + at[3] * normal
        assert top @ normal == pytest.approx(height * normal[2], abs=5e-4)
        assert np.linalg.norm(nodes - top, axis=-1).min() < 0.002
        radii.append(at[3])
    assert radii == [0.03, 0.01]


def test_there_is_no_bar_where_nothing_is_touched():
    point = Forward(rope(288), []).at(np.empty(0))
    assert bars_under(SimpleNamespace(point=point), -2.0, np.zeros(2)) == []  # pyright: ignore[reportArgumentType]
