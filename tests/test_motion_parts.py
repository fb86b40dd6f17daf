"""What fits on motion are made of: rates, clips, carried frames, finer steps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ropefit.adapters.motion_of import clips_of
from ropefit.fitting.motion import held_back
from ropefit.models.dynamics import finer, refine
from ropefit.models.rates import rates
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.parallel_transport import along, continuous, third, unrolled
from ropefit.solvers.dynamics.problem import Drive
from ropefit.solvers.equilibrium.turns import from_turn, to_turn
from tests.moving_ropes import turned


def test_rates_of_a_parabola_are_exact():
    time = np.r_[np.arange(20) * 0.01, 5 + np.arange(15) * 0.02]
    speed, gain = np.array([0.3, -1.0, 2.0]), np.array([1.0, 4.0, -9.81])
    values = 0.7 + time[:, None] * speed + 0.5 * time[:, None] ** 2 * gain
    first, second = rates(time, values, clips_of(time))
    assert np.abs(first - (speed + time[:, None] * gain)).max() < 1e-9
    assert np.abs(second - gain).max() < 1e-6


def test_clips_are_parted_by_pauses_and_by_clocks_that_go_back():
    time = np.r_[np.arange(30), 40 + np.arange(20), np.arange(10)] * 0.01
    assert [len(c) for c in clips_of(time)] == [30, 20, 10]
    assert len(clips_of(np.arange(5.0))) == 5  # a second apart: no motion is seen


@given(st.integers(1, 12), st.floats(0, 0.9))
def test_what_is_held_back_is_not_fitted(count, share):
    clips = np.split(np.arange(count * 30), count)
    train, out = held_back(clips, count * 30, share)
    assert train
    assert not out[np.concatenate(train)].any()
    assert len(np.concatenate(train)) + out.sum() == count * 30


def test_carried_frames_keep_their_tangent_and_do_not_roll():
    """Once round a cone and back the same way: the frame is the same again."""
    angle = np.r_[np.linspace(0, 4, 200), np.linspace(4, 0, 200)]
    tangent = np.stack([0.5 * np.cos(angle), 0.5 * np.sin(angle), np.full(400, 0.8)], axis=1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    q = along(quaternion_along(tangent[0]), tangent)
    assert np.abs(third(q) - tangent).max() < 1e-12
    assert np.abs(q[-1] - q[0]).max() < 1e-12
    roll = to_turn(q[:-1], np.diff(q, axis=0), 2.0)[:, 2]
    assert np.abs(roll).max() < 1e-3


def circling(clips: int) -> tuple[np.ndarray, np.ndarray]:
    """Clamps (F, 2, 4) with rolls of no meaning, near one about -z, far one about +x, and straight
    curves (F, 5, 3)."""
    angle = np.linspace(0, 6, 50 * clips)
    near = np.stack([0.4 * np.cos(angle), 0.4 * np.sin(angle), -np.ones_like(angle)], axis=1)
    far = np.stack([np.ones_like(angle), 0.3 * np.sin(angle), 0.3 * np.cos(angle)], axis=1)
    clamp = np.stack([[quaternion_along(v) for v in way] for way in (near, far)], axis=1)
    return clamp, np.broadcast_to(np.linspace([0.0, 0, 0], [0.5, 0, -0.5], 5), (len(angle), 5, 3))


def test_clamps_whose_roll_is_not_seen_keep_their_tangents_and_do_not_roll():
    clamp, curve = circling(2)
    clips = [np.arange(50), np.arange(50, 100)]
    both, _ = unrolled(clamp, curve, clips)
    np.testing.assert_allclose(third(both), third(clamp), atol=1e-9)
    for clip in clips:
        for end in range(2):
            q = both[clip, end]
            assert np.abs(to_turn(q[:-1], np.diff(q, axis=0), 2.0)[:, 2]).max() < 2e-3


def test_clips_begin_with_rolls_that_agree():
    """Where a clip begins near another's first tangent, the clamp is near that, too: a direction
    that is nearly opposite to e3 once turned clamps of nearly one tangent apart by radians."""
    clamp, curve = circling(4)
    both, _ = unrolled(clamp, curve, np.split(np.arange(200), 4))
    first = both[::50]
    apart = np.abs((first[:, None] * first[None]).sum(-1)).min(axis=(0, 1))
    assert (2 * np.arccos(apart) < 1.0).all()
    roll = np.abs((clamp[::50, 0][:, None] * clamp[::50, 0]).sum(-1)).min()
    assert 2 * np.arccos(roll) > 2.0


def test_the_turn_of_a_clamp_without_twist_is_told():
    """Turned by that angle, the far clamp is the near one as transported along the curve."""
    clamp, curve = circling(1)
    both, angle = unrolled(clamp, curve, [np.arange(50)])
    ways = np.array([third(both[0, 0]), *np.diff(curve[0], axis=0)[1:-1], third(both[0, 1])])
    flat = along(both[0, 0], ways)[-1]
    turned_far = turned(both[0, 1], np.array([0.0, 0.0, angle]))
    assert abs(turned_far @ flat) > 1 - 1e-9


def test_signs_of_quaternions_are_made_continuous():
    q = np.array([[1.0, 0, 0, 0], [-0.99, 0.1, 0, 0], [0.98, -0.2, 0, 0]])
    out = continuous(q)
    assert np.allclose(out, [[1, 0, 0, 0], [0.99, -0.1, 0, 0], [0.98, -0.2, 0, 0]])


def test_turns_and_quaternions_are_each_others_inverse():
    random = np.random.default_rng(0)
    q = random.normal(size=(7, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    turn = random.normal(size=(7, 3))
    assert np.allclose(to_turn(q, from_turn(q, turn, 0.5), 2.0), turn)
    step = turned(q, 1e-6 * turn) - q
    assert np.allclose(step / 1e-6, from_turn(q, turn, 0.5), atol=1e-5)


def test_finer_steps_pass_through_the_recorded_ones():
    time = np.arange(12) * 0.01
    ends = np.stack([np.sin(9 * time), time**3, time], axis=-1)[:, None].repeat(2, axis=1)
    ends[:, 1] = np.nan
    frame = np.array([1.0, 0, 0, 0])
    clamp = turned(frame, np.stack([time, 2 * time, -time], -1)[:, None].repeat(2, axis=1))
    fine = refine(Drive(time[None], ends[None], clamp[None]), 4)
    assert fine.time.shape == (1, 45)
    assert np.allclose(fine.time[0, ::4], time)
    assert np.allclose(fine.ends[0, ::4, 0], ends[:, 0])
    assert np.isnan(fine.ends[0, :, 1]).all()
    assert np.allclose(fine.clamp[0, ::4], clamp)
    wave = finer(time, np.sin(9 * time)[:, None], 4)
    assert np.abs(wave[:, 0] - np.sin(9 * fine.time[0])).max() < 1e-4
