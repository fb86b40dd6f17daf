"""The way between two frames, followed where bending slips at a limit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ropefit.effects import PlasticSet, ViscoelasticCreep
from ropefit.effects.gradual_friction import GradualFriction
from ropefit.models import history, increments
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.increments import MOST_INCREMENTS, in_increments
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.solution import Solution
from tests.test_memory import settled, there_and_back, with_effect

SET = [0.9, 4.0]


def turning(frames: int) -> Setup:
    """A rope whose end 0 goes to and fro and whose ends are clamped, one of which turns about the
    vertical: curvatures change their direction in the rope."""
    setup = there_and_back(60, frames)
    angle = 0.25 * np.pi + 1.2 * np.sin(2 * np.pi * np.arange(frames) / (frames - 1))
    level = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # the z axis onto x
    about = from_rotation_vector(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    clamp = np.stack([multiply(about, level), np.tile(level, (frames, 1))], axis=1)
    return setup._replace(clamp=clamp, time=np.arange(frames, dtype=float))


def between(whole: Setup, parts: np.ndarray) -> Solution:
    """Return the equilibria of all frames in between of a rope that remembers nothing."""
    fine = in_increments(whole, parts)._replace(memory=())
    return Equilibrium(fine, []).at(np.empty(0)).solution.copy()


def test_a_set_in_large_steps_is_that_of_small_ones():
    """Both go straight from frame to frame: the small ones are frames themselves."""
    coarse = with_effect(turning(9), PlasticSet(), SET)
    small = in_increments(coarse, np.repeat([1, 24], [1, 8]))
    fine = settled(small).seen[::24]
    followed = settled(coarse)
    assert followed.increments[0] == 1
    assert 1 <= (followed.increments > 1).sum() <= 4  # where it bends most on the way
    direct = Equilibrium(coarse, [])
    direct.increments = np.ones(9, dtype=int)
    at_once = direct.at(np.empty(0))
    error, before = (np.abs(p.seen - fine).max() for p in (followed, at_once))
    assert before > 2e-3  # m
    assert error < 0.1 * before
    assert (settled(small).increments == 1).all()


@pytest.mark.parametrize(
    ("effect", "values"), [(GradualFriction(), [3e-4, 1.0]), (ViscoelasticCreep(), [0.4, 2.0])]
)
def test_laws_that_are_exact_on_straight_ways_are_not_followed(effect, values):
    assert (settled(with_effect(turning(9), effect, values)).increments == 1).all()


def test_a_rope_that_hardly_bends_more_is_not_followed():
    stiff = [0.5, 1000.0]
    assert (settled(with_effect(turning(9), PlasticSet(), stiff)).increments == 1).all()


def test_directors_of_a_rope_that_spins_freely_do_not_count():
    whole, _ = with_effect(there_and_back(40, 12), PlasticSet(), SET).whole()
    law, rng = history.laws_of(whole), np.random.default_rng(3)
    begins = np.arange(12) == 0
    fine = between(whole, np.where(begins, 1, MOST_INCREMENTS))
    spin = rng.uniform(-3, 3, (len(fine.q), 1, 1)) * np.array([0.0, 0.0, 1.0])
    spun = replace(fine, q=multiply(fine.q, from_rotation_vector(spin)))
    told = increments._until_exact(law, fine, begins, True)
    np.testing.assert_array_equal(increments._until_exact(law, spun, begins, True), told)
    assert told.max() > 1
    assert 1 in told[1:]
    assert increments._until_exact(law, spun, begins, False).sum() > 1.5 * told.sum()


def test_frames_that_do_not_settle_without_memory_are_followed_most_closely():
    setup = with_effect(there_and_back(40), PlasticSet(), SET)
    whole, _ = setup.whole()

    def without_past(parts: np.ndarray) -> Solution:
        found = between(whole, parts)
        found.q[5] = np.nan  # on the way to the second frame
        return found

    law = history.laws_of(whole)
    parts = increments.increments_of(whole, [], law, True, without_past)
    assert parts[1] == MOST_INCREMENTS
    assert (parts[2:] < MOST_INCREMENTS).any()
