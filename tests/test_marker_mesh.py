"""The mesh of a rope that markers are compared with."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from ropefit.adapters.rope_setup import FEWEST, fewer_segments, segments_for, segments_of
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

LENGTH, WEIGHT = 0.8, 5.0  # m, N/m
PARTS = 12


def observed(source: str = "markers", kind: tuple[str, str] = ("clamped", "free")) -> Any:
    """What of observations tells the mesh."""
    return SimpleNamespace(
        source=source,
        end_kind=list(kind),
        length=LENGTH,
        node_arc=np.linspace(0, LENGTH, PARTS + 1),
    )  # fmt: skip


def of_stiffness(share: float) -> float:
    """The bending length [m] of a rope whose EI is a share of w L³."""
    return (share * LENGTH**3) ** (1 / 3)


def test_a_stiffer_rope_has_fewer_segments_and_none_longer_in_terms_of_its_bending_length():
    o = observed()
    every = segments_of(o)
    assert segments_for(o, of_stiffness(3e-4)) == every
    assert segments_for(o, 0.0) == every  # not known
    lengths = []
    for share in (3e-4, 1e-3, 3e-3, 1e-2, 1.0):
        many = segments_for(o, of_stiffness(share))
        assert many % PARTS == 0
        assert many >= FEWEST * every - PARTS / 2
        lengths.append(1 / many / share ** (1 / 3))
    assert max(lengths) < 1.1 * lengths[0]
    assert segments_for(o, of_stiffness(1.0)) < 0.5 * every
    assert segments_for(observed("clouds"), of_stiffness(1.0)) == every


def test_what_is_only_explored_has_a_third_of_the_segments():
    o = observed()
    assert fewer_segments(o, 240) == 84
    assert fewer_segments(o, 2 * PARTS) == PARTS
    assert fewer_segments(o, PARTS) is None


def rope(segments: int, bend: float) -> Setup:
    """A clamp at some angles, and the other end free."""
    turns = np.linspace(-2.0, 2.0, 7)
    half = 0.5 * (np.pi + turns)
    ends = np.full((len(turns), 2, 3), np.nan)
    clamp = np.full((len(turns), 2, 4), np.nan)
    ends[:, 0] = 0.0
    clamp[:, 0] = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1)
    properties = uniform(length=LENGTH, segments=segments, bend=bend, density=WEIGHT / 9.81)
    return bare(properties, np.array([0.0, 0.0, -9.81]), ends, clamp, np.zeros(3))


def error_of_rigidity(share: float) -> float:
    """How far the rigidity of three markers on a fine mesh is off on the mesh for it, relative."""
    rigid, places = share * WEIGHT * LENGTH**3, np.array([0.35, 0.7, 1.0])
    fine = Equilibrium(rope(960, rigid), []).at(np.empty(0)).seen
    seen = fine[:, (places * 960).round().astype(int)]
    known = np.tile(places, (len(seen), 1))
    markers = Data(seen, known, np.ones(known.shape, bool), True, np.array([0.0, -2.0, 0.0]))
    coarse = rope(segments_for(observed(), of_stiffness(share)), 1.3 * rigid)
    forward = Equilibrium(coarse, [PARAMETERS["EI"].term(coarse, 1.3 * rigid)])
    found = fit(forward, FitProblem(markers, Noise(), 40), tolerance=1e-12)
    (value,) = found.forward.terms[0].value(found.point.u)
    return abs(float(value) / rigid - 1)


def test_the_rigidity_of_a_stiff_rope_is_no_farther_off_than_that_of_a_soft_one():
    soft, *stiff = (error_of_rigidity(share) for share in (3e-4, 1e-3, 1e-2, 0.1))
    assert 1e-3 < soft < 0.02
    assert max(stiff) < 1.2 * soft
    assert stiff[-1] < 5e-3
