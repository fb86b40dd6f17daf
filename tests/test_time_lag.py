"""The path of the ends between frames, and ends that are recorded late, also in slow recordings."""

import numpy as np
import pytest

from ropefit.adapters.end_path import end_path
from ropefit.effects import TimeLag
from ropefit.rod.quaternion import director
from tests.concealed import rope

STILL = np.tile([1.0, 0.0, 0.0, 0.0], (30, 2, 1))
TIME = 0.5 * np.arange(30)


def poses(time):
    """Ends (F, 2, 3) [m] on a smooth path, and clamps (F, 2, 4) that turn about y."""
    at = np.stack([0.3 * np.sin(0.4 * time), 0.1 * np.cos(0.7 * time), 0 * time], axis=-1)
    half = 0.2 * np.sin(0.5 * time)
    turned = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=-1)
    return np.stack([at, 0 * at], axis=1), np.stack([turned, turned], axis=1)


@pytest.mark.parametrize("lag", [0.25, -0.25, 0.02])
def test_ends_are_where_their_path_leads(lag):
    (ends, clamp), (late, turned) = poses(TIME), poses(TIME + lag)
    clamp[::2] *= -1  # the same rotations
    path = end_path(TIME, np.arange(30), ends, clamp, 1.0)
    assert path is not None
    setup = rope(20, 30)._replace(ends=ends, clamp=clamp, end_path=path)
    few = setup.frames(np.array([3, 7, 20]))
    for now, mine in ((setup, np.arange(30)), (few, [3, 7, 20])):
        moved = TimeLag().apply(now, np.array([lag]))
        inner = np.flatnonzero(np.isin(mine, np.arange(1, 29)))
        np.testing.assert_allclose(moved.ends[inner], late[np.array(mine)[inner]], atol=5e-5)
        np.testing.assert_allclose(moved.ends, late[mine], atol=5e-4)  # beyond its first pose
        np.testing.assert_allclose(director(moved.clamp), director(turned[mine]), atol=5e-4)


def test_a_lag_beside_a_lag_is_their_sum():
    """As where the set-up's own error of the clock is fitted as well."""
    ends, clamp = poses(TIME)
    path = end_path(TIME, np.arange(30), ends, clamp, 1.0)
    setup = rope(20, 30)._replace(ends=ends, clamp=clamp, end_path=path)
    one, other, whole = (np.array([v]) for v in (0.15, 0.2, 0.35))
    twice = TimeLag().apply(TimeLag().apply(setup, one), other)
    once = TimeLag().apply(setup, whole)
    np.testing.assert_allclose(twice.ends, once.ends, atol=1e-12)
    np.testing.assert_allclose(director(twice.clamp), director(once.clamp), atol=1e-12)


def test_clips_have_paths_of_their_own_and_end_at_rest():
    time = np.concatenate([TIME[:12], TIME[:18]])  # the second begins anew
    ends, clamp = poses(time)
    path = end_path(time, np.arange(30), ends, clamp, 1.0)
    assert path is not None
    shift, _ = path.moved(np.float64(0.1))
    np.testing.assert_allclose(shift[11:13], (poses(time + 0.1)[0] - ends)[11:13], atol=1e-4)
    far, farther = (path.moved(np.float64(lag))[0][11] for lag in (2.0, 9.0))
    np.testing.assert_allclose(far, farther)


def test_poses_that_were_held_still_have_no_path():
    ends, clamp = poses(TIME)
    assert end_path(np.arange(30.0), np.arange(30), ends, clamp, 1.0) is None  # no clock
    assert end_path(TIME, np.arange(30), 0 * ends, STILL, 1.0) is None  # nothing moves
    assert end_path(TIME[:3], np.arange(3), ends[:3], clamp[:3], 1.0) is None
    assert not TimeLag().applies(rope(20, 3))


@pytest.mark.parametrize(("lag", "lost"), [(-0.6, [0]), (1.2, [28, 29]), (0.5, []), (-0.5, [])])
def test_frames_whose_pose_is_outside_the_recording_are_unknown(lag, lost):
    """The path goes on for the time between two frames beyond the first pose and the last."""
    ends, clamp = poses(TIME)
    path = end_path(TIME, np.arange(30), ends, clamp, 1.0)
    setup = rope(20, 30)._replace(ends=ends, clamp=clamp, end_path=path)
    late = TimeLag().apply(setup, np.array([lag]))
    x = np.zeros((30, 21, 3))
    assert np.flatnonzero(TimeLag().begun_before(late, x)).tolist() == lost
    assert not TimeLag().begun_before(setup._replace(end_path=None), x).any()
