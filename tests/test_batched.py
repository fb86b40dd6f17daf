"""Equilibria as tensors on a device: those of the compiled path, with the same derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.robustness.random_ropes import placements
from reference_simulators.energy_balance import equilibrium_residual
from reference_simulators.rod_energy import energy
from ropefit.inference.identify import Task, grid_search
from ropefit.inference.search_space import Space
from ropefit.losses.objectives import OBJECTIVES, Pinhole, Scene
from ropefit.losses.primary import Observed
from ropefit.models.equilibrium_rope import NAMES, EquilibriumRope
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.rod.rod import Rod, build, uniform
from ropefit.rod.setup import bare
from ropefit.solvers.batched import solve as batched
from ropefit.solvers.batched.implicit import settled_batched
from ropefit.solvers.batched.solve import solve_batched
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settled
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.status import Status
from tests.rods import DOWN, NOT_HELD
from tests.test_equilibrium_gradients import BY_FRAME, BY_ROD, CASES, loss_of

CPU = torch.device("cpu")


@pytest.fixture
def handed_over(monkeypatch) -> list[int]:
    """How many frames each call left to the compiled path."""
    calls: list[int] = []

    def counted(rod, conditions, *rest, **named):
        calls.append(len(conditions.ends))
        return solve(rod, conditions, *rest, **named)

    monkeypatch.setattr(batched, "solve", counted)
    return calls


@pytest.mark.parametrize("clamped", [False, True], ids=["pinned", "clamped"])
def test_random_placements(clamped, handed_over):
    p = placements(200, clamped, seed=1)
    by_rope, together = solve(p.rod, p.conditions), solve_batched(p.rod, p.conditions, CPU)
    assert together.converged.all()
    assert sum(handed_over) <= 2
    assert np.abs(together.x - by_rope.x).max() < 1e-9
    assert np.abs(together.q - by_rope.q).max() < 1e-9
    assert equilibrium_residual(p.rod, p.conditions, together).max() < 1e-8


@pytest.mark.parametrize("name", CASES)
def test_states_and_gradients_of_the_compiled_path(name, handed_over):
    """Stretchy, sheared, bent at rest, supported, with end moments; every input's gradient."""
    rod, conditions = CASES[name].build()
    inputs = {k: getattr(rod, k) for k in BY_ROD}
    inputs |= {k: v for k in BY_FRAME if (v := getattr(conditions, k)) is not None}
    found = {}
    for way in ("compiled", "batched"):
        leaves = {k: v.detach().clone().requires_grad_() for k, v in inputs.items()}
        r = Rod(*(leaves[k] for k in BY_ROD))
        c = replace(conditions, **{k: leaves[k] for k in BY_FRAME if k in leaves})
        compiled = way == "compiled"
        solution = solve(r, c) if compiled else solve_batched(r, c, CPU)
        state = settled(solution, r, c) if compiled else settled_batched(solution, r, c, CPU)
        assert solution.converged.all()
        loss_of(state.x, state.q).backward()
        grads = {k: leaf.grad for k, leaf in leaves.items()}
        found[way] = (state.x.detach(), state.q.detach(), grads)
    (x, q, exact), (x_too, q_too, grads) = found["compiled"], found["batched"]
    assert not handed_over
    assert (x - x_too).abs().max() < 1e-9
    assert (q - q_too).abs().max() < 1e-9
    for key, value in exact.items():
        held = torch.isfinite(inputs[key])
        if not held.any():
            continue
        other = grads[key] if grads[key] is not None else torch.zeros_like(value)
        error = (value - other)[held].abs().max() / value[held].abs().max().clamp_min(1.0)
        assert error < 1e-7, f"{key}: {float(error):.1e}"


def hanging(apart: torch.Tensor, bend: torch.Tensor) -> tuple[Rod, Conditions]:
    properties = uniform(length=1.0, segments=15, bend=bend, axial=50.0, density=1.0)
    ends = torch.zeros(len(apart), 2, 3, dtype=torch.float64)
    ends[:, 1, 0] = apart
    pinned = torch.full((len(apart), 2, 4), torch.nan, dtype=torch.float64)
    return build(properties, DOWN, (False, False)), Conditions(ends, pinned)


def test_energy_is_stationary():
    """Judged by the physics as written once, apart from either solver."""
    rod, conditions = hanging(torch.tensor([0.3, 0.9]), torch.tensor([1e-3, 5e-3]))
    solution = solve_batched(rod, conditions, CPU)
    state = settled_batched(solution, rod, conditions, CPU)
    assert solution.converged.all()
    clamp = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64).expand(2, 2, 4)
    x, q = state.x.clone().requires_grad_(), state.q.clone().requires_grad_()
    by_x, by_q = torch.autograd.grad(energy(rod, x, q, clamp).sum(), (x, q))
    assert by_x[:, 1:-1].abs().max() < 1e-8
    along = (by_q * q).sum(-1, keepdim=True) * q  # the length of q is not free
    assert (by_q - along).abs().max() < 1e-8


def test_what_does_not_arrive_is_marked_or_finished(handed_over, monkeypatch):
    """Ropes that cannot reach both ends are marked; slow ones are finished by the compiled path."""
    rod, conditions = hanging(torch.tensor([0.5, 0.6]), torch.tensor([1e-3, 1e-3]))
    short = rod._replace(flexibility=torch.zeros_like(rod.flexibility))
    conditions.ends[1, 1, 0] = 1.2
    solution = solve_batched(short, conditions, CPU)
    assert solution.converged.tolist() == [True, False]
    state = settled_batched(solution, short, conditions, CPU)
    assert torch.isfinite(state.x[0]).all()
    assert torch.isnan(state.x[1]).all()
    monkeypatch.setattr(batched, "STEPS", 3)
    handed_over.clear()
    slow = solve_batched(rod, conditions, CPU)
    assert slow.converged.all()
    assert handed_over == [2]
    assert np.abs(slow.x - solve(rod, conditions).x).max() < 1e-9
    assert (slow.status == Status.CONVERGED).all()


def test_every_tensor_is_made_on_the_device_asked_for():
    """Tensors made without a device would be meta tensors here, and using one would fail."""
    rod, conditions = CASES["clamped"].build()
    rod = rod._replace(stiffness=rod.stiffness.clone().requires_grad_())
    start: Solution = solve(rod, conditions)
    far = start.copy()
    far.q[:] = far.q[::-1]
    torch.set_default_device("meta")
    try:
        solution = solve_batched(rod, conditions, CPU, start=far)
        state = settled_batched(solution, rod, conditions, CPU)
        state.x.sum().backward()
    finally:
        torch.set_default_device(None)
    assert solution.converged.all()
    assert rod.stiffness.grad is not None
    assert rod.stiffness.grad.device == CPU


def test_search_settles_its_candidates_there():
    """A grid's losses and a gradient, with the device and without."""
    ends = np.zeros((2, 2, 3))
    ends[:, 1, 0] = [0.4, 0.8]
    properties = uniform(length=1.0, segments=16, bend=1e-3, density=0.05)
    setup = bare(properties, DOWN, ends, np.tile(NOT_HELD, (2, 1, 1)), np.array([0.5, -1.0, 0.0]))
    rope = EquilibriumRope(setup, 2, 0, tied=True)
    seen = rope.settle(torch.tensor([4e-3, 1.0, torch.inf, 1.02], dtype=torch.float64).repeat(2, 1))
    everywhere = torch.ones(2, 9, dtype=torch.bool)
    data = Observed(
        seen.x, everywhere, torch.arange(9).clamp_max(7).repeat(2, 1), seen.x, everywhere
    )
    camera = Pinhole(torch.ones(2), torch.zeros(2), torch.eye(3).double(), torch.zeros(3).double())
    scene = Scene(data, data, camera, torch.ones(2), seen.x[:, 4], torch.tensor(DOWN / 9.81))
    known = {name: PARAMETERS[name].range(setup) for name in NAMES}
    known["EA"] = Range(math.inf, 1.0, math.inf)
    space = Space.of(NAMES, ["EI", "length"], {}, known)
    task = Task(rope, scene, OBJECTIVES["OBJ1"], space, torch.zeros(2, dtype=torch.int64))
    there = replace(task, rope=replace(rope, device=CPU))
    found = [grid_search(t, levels=3, rounds=2) for t in (task, there)]
    assert torch.allclose(found[0].u, found[1].u, rtol=0, atol=1e-9)
    assert torch.allclose(found[0].loss, found[1].loss, rtol=0, atol=1e-9)
    assert float(found[0].loss) < float(found[0].trace[0])
    slopes = []
    for t in (task, there):
        u = found[0].u.clone().requires_grad_()
        slopes.append(torch.autograd.grad(t.loss(u, torch.zeros(1, dtype=torch.int64)).sum(), u)[0])
    assert torch.allclose(*slopes, rtol=1e-7, atol=1e-12)
