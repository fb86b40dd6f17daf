"""The way between two frames, followed where bending slips at a limit."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.effects import PlasticSet, ViscoelasticCreep
from ropefit.effects.gradual_friction import GradualFriction
from ropefit.models import history, increments
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.increments import MOST_INCREMENTS, in_increments
from ropefit.rod.setup import Setup
from tests.test_memory import settled, there_and_back, with_effect

SET = [0.9, 4.0]


def turning(frames: int) -> Setup:
    """A rope whose end 0 goes to and fro and whose ends are clamped, one of which turns about the
    vertical: curvatures change their direction in the rope."""
    setup = there_and_back(60, frames)
    angle = 0.25 * np.pi + 1.2 * np.sin(2 * np.pi * np.arange(frames) / (frames - 1))
    level = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # the z axis onto x
    about = np.zeros((frames, 4))
    about[:, 0], about[:, 3] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    a, b, c, d = about.T
    w, x, y, z = level
    clamp = np.empty((frames, 2, 4))
    clamp[:, 1] = [0.5**0.5, 0.0, 0.5**0.5, 0.0]
    clamp[:, 0] = np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
    return setup._replace(clamp=clamp, time=np.arange(frames, dtype=float))


def test_a_set_in_large_steps_is_that_of_small_ones(monkeypatch: pytest.MonkeyPatch):
    """Both go straight from frame to frame: the small ones are frames themselves."""
    coarse = with_effect(turning(9), PlasticSet(), SET)
    fine = settled(in_increments(coarse, np.repeat([1, 24], [1, 8]))).seen[::24]
    followed = settled(coarse)
    assert followed.increments[0] == 1
    assert (followed.increments[1:] > 1).any()
    monkeypatch.setattr(increments, "MOST_INCREMENTS", 1)
    at_once = settled(coarse)
    assert (at_once.increments == 1).all()
    error, before = (np.abs(p.seen - fine).max() for p in (followed, at_once))
    assert before > 2e-3  # m
    assert error < 0.1 * before


@pytest.mark.parametrize(
    ("effect", "values"), [(GradualFriction(), [3e-4, 1.0]), (ViscoelasticCreep(), [0.4, 2.0])]
)
def test_laws_that_are_exact_on_straight_ways_are_not_followed(effect, values):
    assert (settled(with_effect(turning(9), effect, values)).increments == 1).all()


def test_a_rope_that_hardly_bends_more_is_not_followed():
    stiff = [0.5, 1000.0]
    assert (settled(with_effect(turning(9), PlasticSet(), stiff)).increments == 1).all()


def test_directors_of_a_rope_that_spins_freely_do_not_count():
    setup = with_effect(there_and_back(40), PlasticSet(), SET)
    whole, _ = setup.whole()
    law = history.laws_of(whole)
    rng = np.random.default_rng(3)
    vector = 0.01 * rng.normal(size=(24, 41, 2))
    angle = rng.uniform(-3, 3, 24)
    spin = np.stack([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    spun = np.einsum("abf,fnb->fna", spin, vector)
    np.testing.assert_allclose(
        increments._bent(law, spun, True), increments._bent(law, vector, True), atol=1e-12
    )
    assert (increments._bent(law, spun, False) > increments._bent(law, vector, True)).any()


def test_frames_that_do_not_settle_without_memory_are_followed_most_closely():
    setup = with_effect(there_and_back(40), PlasticSet(), SET)
    point = Equilibrium(setup, []).at(np.empty(0))
    lost = point.solution.copy()
    lost.q[5] = np.nan
    whole, _ = setup.whole()
    parts = increments.increments_of(whole, [], history.laws_of(whole), lost, True)
    assert parts[5] == parts[6] == MOST_INCREMENTS
