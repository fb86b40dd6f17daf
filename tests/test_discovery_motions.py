"""Ropes in motion for the blind benchmark: what is told, how visible it is, what the table says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.discovery import motion_scenes as scenes
from benchmarks.discovery import motion_score, motions


@pytest.fixture(scope="module")
def lagging() -> scenes.Scene:
    return scenes.staged(2, "standard")


def test_what_is_told_is_the_scene_without_its_cause(lagging):
    assert lagging.cause == "time_lag"
    assert lagging.concealed is not None
    plain = scenes.as_told(lagging)
    np.testing.assert_allclose(plain.world.rod.gravity, lagging.setting.rod.gravity)
    for mine, true in zip(plain.poses, lagging.poses, strict=True):
        np.testing.assert_allclose(mine(0.5)[0], true(0.5 - lagging.concealed.size)[0])
    long = replace(lagging, told=replace(lagging.told, length=1.03, lag=0.0, gravity_tilt=0.05))
    rod, plain = scenes.as_told(long).world.rod, lagging.setting.rod
    assert rod.length == pytest.approx(1.03 * plain.length)
    assert rod.density * rod.length == pytest.approx(plain.density * plain.length)
    assert np.arctan2(rod.gravity[0], -rod.gravity[2]) == pytest.approx(0.05)


def test_a_linear_drag_stands_for_one_that_grows_with_speed(lagging):
    rng = np.random.default_rng(0)
    way = rng.standard_normal((scenes.MARKERS, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    time = np.tile(scenes.TIMES, scenes.CLIPS)
    steady = 0.7 * time[:, None, None] * way  # each marker at 0.7 m/s, there and anew
    law = replace(lagging.concealed, drag=2.0)
    fast = replace(lagging, concealed=law)
    expected = scenes.LAW_DRAG * lagging.rate * 0.7 / scenes.LAW_SPEED
    assert motion_score.linear_drag(fast, steady) == pytest.approx(expected, rel=1e-9)
    assert motion_score.linear_drag(lagging, steady) == lagging.rate


def test_what_the_nominal_rope_explains_is_no_signal():
    rng = np.random.default_rng(1)
    shape = (scenes.CLIPS * scenes.FRAMES, scenes.MARKERS, 3)
    one, two, other = rng.standard_normal((3, *shape))
    left = motion_score.beside(1e-3 * one - 4.0 * two + other, [1e6 * one, two])
    used = motion_score.beside(other, [0 * one])
    assert np.linalg.norm(motion_score.beside(one, [one, two])) < 1e-9
    assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(used), rel=0.01)
    frames = len(range(0, scenes.FRAMES, motion_score.EACH))
    assert left.size == scenes.CLIPS * frames * scenes.MARKERS * 3


def test_the_table_counts_what_is_visible_apart():
    held = {"rms_before_m": 0.004, "rms_after_m": 0.002}
    answer = {"verdict": "none", "effects": [], "heldout": held}
    row = {"seed": 1, "cause": "drag", "right": False, "first": False, "in_set": False,
           "size": None, "score": 5.0, "answer": answer, "seconds": {"diagnose": 1.0}}  # fmt: skip
    found = row | {"seed": 3, "right": True, "first": True, "in_set": True, "score": 30.0}
    clean = found | {"seed": 4, "cause": "nothing", "score": None}
    text = motions.table([row, found, clean], "forces")
    assert "| drag | 18 | 2 | 1 | 1 |" in text
    assert "| all with a cause | 18 | 2 | 1 | 1 |" in text
    assert "| visible, all | 30 | 1 | 1 | 1 |" in text
    assert "| nothing | - | 1 |" in text
    assert "1 (drag, score 5): none" in text
