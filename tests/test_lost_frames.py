"""Frames that a clip of motion capture has lost are found, counted, and told."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.perception.lost_frames import lost_frames, repeated, skipped
from ropefit.perception.tracing import Tracer
from tests.test_recording_checks import recording, swaying

NOISE = 2e-4  # m


def clip(frames: int = 200) -> np.ndarray:
    """(F, 9, 3) [m] markers in motion."""
    rng = np.random.default_rng(5)
    return swaying(frames, 0.2) + rng.normal(0, NOISE, (frames, 9, 3))


def clock(frames: int) -> np.ndarray:
    return 0.01 * np.arange(frames)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("at", [56, 77, 95, 112])
def test_frames_that_are_left_out(at: int, count: int) -> None:
    positions = np.delete(clip(), range(at, at + count), axis=0)
    found = skipped(positions, clock(len(positions)))
    assert found.rows.tolist() == [at]
    assert found.count.tolist() == [count]
    true = np.delete(clock(200), range(at, at + count))
    assert not skipped(positions, true).rows.size  # the times tell of it


def test_nothing_is_lost_where_nothing_is() -> None:
    for positions in (clip(), clip() * [1, 0, 1] + 1e-3, np.cumsum(clip() - clip()[0], axis=0)):
        assert not lost_frames(list(range(200)), positions, clock(200))
    still = swaying(100, 0.0) + np.random.default_rng(1).normal(0, NOISE, (100, 9, 3))
    assert not lost_frames(list(range(100)), still, clock(100))
    assert not lost_frames(list(range(100)), swaying(100, 0.0), clock(100))


def test_an_end_that_stops_at_once_is_no_lost_frame() -> None:
    at = np.minimum(clock(200), 0.9)
    positions = swaying(200, 0.0) + np.stack([at * 0, at * at, at * 0], axis=1)[:, None]
    positions += np.random.default_rng(2).normal(0, NOISE, positions.shape)
    assert not skipped(positions, clock(200)).rows.size


def test_frames_that_repeat_others() -> None:
    positions = clip()
    positions[50:53] = positions[49]
    expected = np.zeros(200, bool)
    expected[50:53] = True
    np.testing.assert_array_equal(repeated(positions), expected)
    (text,) = lost_frames(list(range(200)), positions, clock(200))
    assert "3 frames (50, 51, 52)" in text
    assert "repeat others" in text
    positions[:20] = positions[19]  # at rest, as a simulation without noise
    np.testing.assert_array_equal(repeated(positions), expected)


def test_frames_without_any_marker() -> None:
    positions = clip()
    positions[[30, 31, 90]] = np.nan
    for time in (clock(200), None):
        (text,) = lost_frames(list(range(100, 300)), positions, time)
        assert "no marker is seen in 3 frames (130, 131, 190): excluded" in text


def test_they_are_told_of_a_recording(tmp_path) -> None:
    positions = np.delete(clip(), [95, 96], axis=0)
    told = [w for w in Tracer(recording(tmp_path / "r", positions)).warnings if "lost" in w]
    assert len(told) == 1
    assert "before frame 95: about 2 frames lost there" in told[0]
    assert "leave these clips out" in told[0]
