"""What fits on motion are made of: rates, clips, carried frames, finer steps."""

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from ropefit.adapters.motion_of import clips_of, rates
from ropefit.fitting.motion import held_back
from ropefit.models.dynamics import finer, refine
from ropefit.recordings.ends import quaternion_along
from ropefit.rod.carried import along, carried, continuous, third
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
    clamp = np.stack([q, q], axis=1)
    line = np.linspace([0.0, 0, 0], [0, 0, 1], 5) @ np.eye(3)
    curve = np.broadcast_to(line, (400, 5, 3))
    both = carried(-clamp, curve, [np.arange(400)])
    assert np.abs(third(both) - third(clamp)).max() < 1e-9
    assert (np.abs((both[1:] * both[:-1]).sum(-1)) > 0.99).all()


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
    step = turned(torch.from_numpy(q), torch.from_numpy(1e-6 * turn)).numpy() - q
    assert np.allclose(step / 1e-6, from_turn(q, turn, 0.5), atol=1e-5)


def test_finer_steps_pass_through_the_recorded_ones():
    time = torch.arange(12, dtype=torch.float64) * 0.01
    ends = torch.stack([torch.sin(9 * time), time**3, time], dim=-1)[:, None].repeat(1, 2, 1)
    ends[:, 1] = torch.nan
    frame = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64)
    clamp = turned(frame, torch.stack([time, 2 * time, -time], -1)[:, None].repeat(1, 2, 1))
    fine = refine(Drive(time[None], ends[None], clamp[None]), 4)
    assert fine.time.shape == (1, 45)
    assert torch.allclose(fine.time[0, ::4], time)
    assert torch.allclose(fine.ends[0, ::4, 0], ends[:, 0])
    assert torch.isnan(fine.ends[0, :, 1]).all()
    assert torch.allclose(fine.clamp[0, ::4], clamp)
    wave = finer(time.numpy(), np.sin(9 * time.numpy())[:, None], 4)
    assert np.abs(wave[:, 0] - np.sin(9 * fine.time[0].numpy())).max() < 1e-4
