"""Random ropes in random motions: what is called converged is so, by checks that can fail."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from benchmarks.robustness.quasi_static import (
    concatenated,
    distance_to_reference,
    follow_random_paths,
    rope,
    whole_turns,
)
from benchmarks.robustness.random_ropes import motions, paths
from reference_simulators.energy_balance import (
    energy_gain,
    equilibrium_residual,
    rates,
    step_residual,
)
from ropefit.rod.quaternion import conjugate_product, from_rotation_vector, multiply
from ropefit.solvers.dynamics import solve as dynamics
from ropefit.solvers.equilibrium.branches import follow, turned_over
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve


@pytest.mark.parametrize("clamped", [False, True], ids=["pinned", "clamped"])
def test_moved_from_pose_to_pose(clamped):
    count, frames, nodes = 40, 5, 20
    m = follow_random_paths(count, clamped, nodes, frames, seed=3)
    held = Conditions(
        *(np.concatenate([getattr(c, name) for c in m.conditions]) for name in ("ends", "clamp"))
    )
    bend = np.repeat(m.bend, frames)
    each = rope(bend, nodes - 1, clamped)
    s = concatenated(m.states, each, held)
    assert s.converged.all()
    assert equilibrium_residual(rope(bend, nodes - 1, clamped), held, s).max() < 1e-8
    assert not whole_turns(m).any()
    near = np.array([distance_to_reference(m, k, 4, clamped) for k in range(5)])
    found = near[np.isfinite(near[:, 0])]
    assert len(found) >= 4
    assert found[:, 1].max() < 0.02
    assert (found[:, 1] < 0.5 * found[:, 0]).all()


def test_long_steps_are_taken_in_halves():
    """Long steps wind some ropes by a turn; following does so only where a joint folds over."""
    count, segments, bend = 30, 29, 5e-3
    way = paths(np.random.default_rng(0), count, np.linspace(0, 1, 6), np.full(count, 2.0), 1.0)
    rod = rope(bend, segments, True)
    jumped = 0
    for ends, clamp in zip(way.ends, way.clamp, strict=True):
        frames = [Conditions(ends[t : t + 1], clamp[t : t + 1]) for t in range(6)]
        state = solve(rod, frames[0])
        for here, there in pairwise(frames):
            after = solve(rod, there, state)
            jumped += int(turned_over(here, state, there, after)[0])
            state = after
    m = follow_random_paths(count, True, segments + 1, 6, seed=0)
    assert jumped > 3
    assert not whole_turns(m).any()


def test_turned_over_tells_a_whole_turn():
    """A clamp turned once about in steps: the rope that followed is wound up, that from
    the catenary is not, whatever the sign of a clamp's quaternion."""
    angle = np.linspace(0, 2 * np.pi, 13)
    turn = from_rotation_vector(np.stack([0 * angle, 0 * angle, angle], axis=-1))
    along_x = np.tile([0.5**0.5, 0.0, 0.5**0.5, 0.0], (13, 1))
    ends = np.zeros((13, 2, 3))
    ends[:, 1, 0] = 0.9
    held = Conditions(ends, np.stack([along_x, multiply(along_x, turn)], axis=1))
    rod = rope(1e-2, 20, True)
    followed = follow(rod, held)
    last = held.frames(np.array([12]))
    there, fresh = followed.frames(np.array([12])), solve(rod, last)
    assert there.converged[0]
    assert np.abs(fresh.x - followed.x[0]).max() < 1e-8  # the same clamps once more
    assert not turned_over(last, there, last, there)[0]
    for clamp in (last.clamp, -last.clamp, last.clamp * [[1.0], [-1.0]]):
        assert turned_over(last, there, replace(last, clamp=clamp), fresh)[0]


@pytest.mark.parametrize("ends", ["pinned", "clamped", "hung"])
@pytest.mark.parametrize("stretchy", [False, True], ids=["inextensible", "stretchy"])
def test_steps_of_ropes_in_motion(ends, stretchy):
    m = motions(150, ends, stretchy, 20, 30, 1)
    found = dynamics.solve(m.rope, m.drive, m.start)
    assert found.converged.mean() > 0.6
    there = np.isfinite(found.x.sum((-1, -2)))
    assert np.array_equal(there.all(axis=-1), found.converged)
    off = step_residual(m.rope, m.drive, m.start, found)
    assert np.array_equal(np.isnan(off), ~there)
    assert np.nanmax(off) < 1e-6
    assert energy_gain(m.rope, m.drive, m.start, found, m.rest)[found.converged].max() < 0.1
    # The check can fail: a node or a frame of one step a little off.
    step = int(found.done[found.converged].min()) // 2
    for name in ("x", "q"):
        changed = getattr(found, name).copy()
        changed[:, step, 7] += 1e-5
        other = replace(found, **{name: changed})
        moved = step_residual(m.rope, m.drive, m.start, other)[found.converged]
        assert (moved[:, step] > 1e-6).mean() > 0.95


def test_a_rope_that_is_free_to_spin_does_not():
    """What costs nothing is not taken for motion: between steps no segment turns much about
    itself, though it may turn across."""
    m = motions(150, "pinned", False, 20, 30, 1)
    found = dynamics.solve(m.rope, m.drive, m.start)
    free = found.converged & ~(m.rope.bend_viscosity != 0).any((-1, -2))
    assert free.sum() > 15
    q = found.q[free]
    turn = conjugate_product(q[:, :-1], q[:, 1:])
    spin = 2 * np.arctan2(turn[..., 3], np.abs(turn[..., 0]))
    assert np.abs(np.median(spin, axis=-1)).max() < 0.5


def test_rates_of_a_parabola_are_exact():
    time = torch.tensor([[0.0, 0.1, 0.25, 0.3, 0.5]], dtype=torch.float64)
    y = (3 * time**2 - time + 1)[..., None]
    slope = rates(time, y, torch.tensor([[-1.0]], dtype=torch.float64))
    expected = (6 * time - 1)[..., None]
    assert torch.allclose(slope[:, 2:], expected[:, 2:], rtol=0, atol=1e-12)
    assert float(slope[0, 1, 0]) == pytest.approx((float(y[0, 1, 0]) - 1) / 0.1)
