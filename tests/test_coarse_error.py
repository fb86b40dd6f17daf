"""What too few nodes do to a simulated shape, with its derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.effects import Kink, PointForce, PointMass, TooCoarse
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.coarse_error import COARSENING, CoarseError, coarsened
from tests.concealed import rope

WEIGHT = PointMass(), np.array([0.004, 0.4])
BENT = Kink(), np.array([0.4, 0.2, np.log(0.02), 0.5])


def with_effect(effect, values) -> Setup:
    return effect.apply(rope(96), values)


@pytest.mark.parametrize(("effect", "values"), [WEIGHT, BENT])
def test_the_coarse_rope_has_what_is_on_the_nodes(effect, values):
    """In all and at its place: an error of the mesh is not the absence of a weight."""
    setup = with_effect(effect, values)
    coarse = coarsened(setup)
    assert coarse.segments == setup.segments // COARSENING
    assert coarse.arc[-1] == pytest.approx(setup.arc[-1])
    for name in ("mass", "kinks"):
        few, many = getattr(coarse, name), getattr(setup, name)
        np.testing.assert_allclose(few.sum(axis=0), many.sum(axis=0), atol=1e-15)
        np.testing.assert_allclose(coarse.arc @ few, setup.arc @ many, atol=1e-12)
    without = np.abs(CoarseError.of(rope(96), 1.0).move).max()
    moved = np.abs(CoarseError.of(setup, 1.0).move).max()
    effect_of_it = np.abs(
        Equilibrium(setup, []).at(np.empty(0)).seen - Equilibrium(rope(96), []).at(np.empty(0)).seen
    ).max()
    assert moved < without + 0.2 * effect_of_it


def test_loads_of_each_frame_are_its_own_on_the_coarse_rope():
    setup = with_effect(*WEIGHT)
    frames = len(setup.ends)
    load = np.zeros((frames, 97, 3))
    load[:, 30, 0] = np.linspace(0.0, 0.02, frames)
    setup = setup._replace(load=load)
    np.testing.assert_allclose(coarsened(setup).load.sum(axis=1), load.sum(axis=1), atol=1e-15)
    whole = CoarseError.of(setup, 2.0)
    few = np.array([1, 3])
    np.testing.assert_allclose(whole.frames(few).move, whole.move[few], atol=1e-9)


@pytest.mark.parametrize("sideways", [False, True])
def test_derivatives_are_exact(sideways: bool):
    """In its amount, in what the rope is, and in what holds it; with loads of each frame, too."""
    base = with_effect(*WEIGHT)
    if sideways:
        base = PointForce().apply(base, np.array([0.01, 0.02, 0.0, 0.3]))
        base = base._replace(load=np.repeat(base.load[None], len(base.ends), axis=0))
    one = np.ones(1)
    mesh = Term(
        "too_coarse", ("amount",), ("1",), lambda setup, v: TooCoarse().apply(setup, v), 2 * one,
        0.5 * one, 0 * one, 60 * one, np.inf * one,
    )  # fmt: skip
    rigidity = PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))
    model = Equilibrium(base, [rigidity, *calibration(base, Priors(), False), mesh])
    u = np.zeros(sum(term.size for term in model.terms))
    point = model.at(u)
    exact, step = model.jacobian(point), 1e-5
    for k, way in enumerate(np.eye(len(u))):
        high, low = (model.at(u + sign * step * way).seen for sign in (1, -1))
        difference = (high - low) / (2 * step)
        assert np.abs(exact[k] - difference).max() < 1e-5 * np.abs(difference).max()


def test_what_it_would_do_where_it_is_not_is_known():
    """As in a scan for it."""
    setup = with_effect(*WEIGHT)
    point = Equilibrium(setup, []).at(np.empty(0))
    (moved,) = point.respond([lambda size: TooCoarse().apply(setup, np.array([size]))])
    error = CoarseError.of(setup, 1.0).move
    assert np.abs(moved - error).max() < 1e-6 * np.abs(error).max()


def test_a_mesh_is_compared_with_one_of_a_quarter_of_its_segments_whatever_their_number():
    """The error is of second order in the length of the segments, at all nodes alike."""
    errors = [CoarseError.of(rope(segments), 1.0).move for segments in (96, 97, 98, 99)]
    least = min(np.abs(error).max() for error in errors)
    assert least > 1e-4
    for error in errors[1:]:
        same = np.stack([
            np.stack([np.interp(np.linspace(0, 1, 33), np.linspace(0, 1, len(axis)), axis)
                      for axis in frame.T], axis=1)
            for frame in (error[0], errors[0][0])
        ])  # fmt: skip
        assert np.abs(same[0] - same[1]).max() < 0.2 * least
    stiff = rope(98)._replace(rigid=np.linspace(0, 0.5, 98))
    assert np.isfinite(CoarseError.of(stiff, 1.0).move).all()
