"""A rope that hangs in a plane is solved there: the same steps and states as in space, and where it
does not plainly lie in one nothing is done."""

from __future__ import annotations

import numba
import numpy as np
import pytest
import torch

from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle
from ropefit.solvers.equilibrium.kernels.newton import REACH
from ropefit.solvers.equilibrium.kernels.planar import solve_in_plane
from ropefit.solvers.equilibrium.kernels.records import held_in, make_work, rod_of
from ropefit.solvers.equilibrium.problem import problem_of
from ropefit.solvers.equilibrium.solve import NEWTON_LIMIT, TOLERANCE, solve
from ropefit.solvers.equilibrium.start import starting
from ropefit.solvers.kernels.linked import EntryCompiler
from tests.tensors import tensors

FRAMES, SEGMENTS = 6, 21
GRAVITY = np.array([3.1, -8.3, 4.2])  # along no axis


@numba.njit(pipeline_class=EntryCompiler)
def in_plane(rods, of, held, q, lam, x0, steps, largest):
    w = make_work(q.shape[1], lam.shape[1], 1)
    for t in range(q.shape[0]):
        steps[t], largest[t] = solve_in_plane(
            rod_of(rods, of[t]),
            held_in(held, t),
            q[t],
            lam[t],
            x0[t],
            TOLERANCE,
            NEWTON_LIMIT,
            REACH,
            w,
        )


def tried(rod: Rod, conditions: Conditions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the steps taken in a plane (F,), the last one's largest turn, and how far any frame
    was moved (F,)."""
    problem = problem_of(rod, conditions, None)
    q, lam, x0 = starting(problem, conditions)
    before, steps, largest = q.copy(), np.zeros(len(q), np.int64), np.zeros(len(q))
    in_plane(*problem, q, lam, x0, steps, largest)
    return steps, largest, np.abs(q - before).max((1, 2))


def held(seed: int, **more) -> Conditions:
    """Ends anywhere, apart by some share of a length of 1 m, on a slope of half at most."""
    rng = np.random.default_rng(seed)
    down = GRAVITY / np.linalg.norm(GRAVITY)
    away = rng.normal(size=(FRAMES, 3))
    away -= (away @ down)[:, None] * down
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away += rng.uniform(-0.5, 0.5, (FRAMES, 1)) * down
    away *= rng.uniform(0.3, 0.95, (FRAMES, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    first = rng.normal(size=(FRAMES, 3))
    ends = np.stack([first, first + away], axis=1)
    return Conditions(ends, np.full((FRAMES, 2, 4), np.nan), **more)


def rope(clamped=(False, False), **values) -> Rod:
    given = {"bend": 3e-3, "axial": 1e4, "shear": 2e3, "density": 0.3} | values
    return build(uniform(length=1.0, segments=SEGMENTS, **given), GRAVITY, clamped)


@pytest.mark.parametrize("curvature", [(0.0, 0.0, 0.0), (0.4, -0.7, 0.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_same_as_in_space(seed, curvature):
    flat, absent = held(seed), np.zeros((FRAMES, 1), bool)
    # A support that is not there: the same rope, but not taken for one that hangs in a plane.
    spatial = held(
        seed, node=np.array([3]), direction=np.ones((FRAMES, 1, 3)),
        offset=np.zeros((FRAMES, 1)),
        compliance=np.zeros((FRAMES, 1)), active=absent,
    )  # fmt: skip
    assert not tried(rope(), spatial)[0].any()
    found, gradients = [], []
    for conditions in (flat, spatial):
        bend = torch.tensor(3e-3, dtype=torch.float64, requires_grad=True)
        axial = torch.tensor(1e4, dtype=torch.float64, requires_grad=True)
        rod = rope(bend=bend, axial=axial, curvature=curvature)
        state, solution = settle(rod, tensors(conditions))
        loss = (torch.sin(7 * state.x)).sum() + (state.q[..., 0] ** 2).sum()
        found.append(solution)
        gradients.append(torch.stack(torch.autograd.grad(loss, (bend, axial))).numpy())
    assert all(solution.converged.all() for solution in found)
    np.testing.assert_array_equal(found[0].iterations, found[1].iterations)
    for name in ("x", "q", "force"):
        one, two = (getattr(solution, name) for solution in found)
        np.testing.assert_allclose(one, two, atol=1e-10 * max(1.0, np.abs(two).max()))
    np.testing.assert_allclose(gradients[0], gradients[1], rtol=1e-8)


@pytest.mark.parametrize("values", [{}, {"curvature": (0.4, -0.7, 0.0)}, {"bend": 2e-2}])
def test_a_pinned_rope_arrives_there(values):
    """So much that nothing is left to be done in space."""
    conditions, rod = held(3), rope(**values)
    steps, largest, moved = tried(rod, conditions)
    assert (steps > 0).all()
    assert (largest < REACH).all()
    assert (moved > 0).all()
    np.testing.assert_array_equal(solve(rod, conditions).iterations, steps)


def test_what_is_not_in_a_plane_is_left_as_it_is():
    kinks = 0.1 * np.random.default_rng(0).normal(size=(SEGMENTS + 1, 3))
    beside = rope()
    beside.load[7] += 0.1 * np.cross(beside.load[7], np.ones(3))
    turning = rope()._replace(moment=np.full((2, 3), 1e-3))
    oval = rope()
    oval.stiffness[5, 0] *= 1.1
    clamp = np.tile([1.0, 0.0, 0.0, 0.0], (FRAMES, 2, 1))
    cases = [
        (rope(curvature=(0.3, 0.0, 0.5)), held(4)),
        (rope()._replace(rest=rope().rest + kinks), held(4)),
        (beside, held(4)),
        (turning, held(4)),
        (oval, held(4)),
        (rope(clamped=(True, True)), Conditions(held(4).ends, clamp)),
        (rope(density=0.0), held(4)),  # any plane
        (rope(density=float("nan")), held(4)),
        (rope(bend=float("nan")), held(4)),
    ]
    for rod, conditions in cases:
        steps, _, moved = tried(rod, conditions)
        assert not steps.any()
        assert not moved.any()


def test_a_rope_out_of_balance_sideways_is_found_unstable_in_space():
    """An arch that is stable in its plane falls over: judged in space, it does not stay."""
    ends = np.zeros((1, 2, 3))
    ends[0, 1, 0] = 0.6
    conditions = Conditions(ends, np.full((1, 2, 4), np.nan))
    down = np.array([0.0, 0.0, -9.81])
    rod = build(uniform(length=1.0, segments=SEGMENTS, bend=2.0, density=0.1), down, (False, False))
    hanging = solve(rod, conditions)
    arch = hanging.states
    arch.x[..., 2] *= -1
    # Half a turn about the line through the ends.
    w, x, y, z = hanging.q.transpose(2, 0, 1)
    arch.q[:] = np.stack([-x, w, -z, y], axis=-1)
    arch.reaction[:, 2] *= -1
    found = solve(rod, conditions, arch)
    assert found.converged.all()
    np.testing.assert_allclose(found.x[..., 2].min(), hanging.x[..., 2].min(), atol=1e-6)


@pytest.mark.parametrize("loose", [0, 1])
def test_a_hanging_rope_starts_hanging(loose):
    """A free end without a clamp begins below, not along the frame that stands for no clamp."""
    ends = np.zeros((1, 2, 3))
    ends[:, loose] = np.nan
    conditions = Conditions(ends, np.full((1, 2, 4), np.nan))
    found = solve(rope(), conditions)
    assert found.converged.all()
    assert found.iterations.max() <= 1
