"""Derivatives of equilibria against differences of equilibria, for every input, and the forward
derivative against the adjoint."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply, normalise
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle, settled
from ropefit.solvers.equilibrium.implicit import Directions, tangent
from ropefit.solvers.equilibrium.solution import Solution
from tests.rods import DOWN, solved
from tests.tensors import tensors

SEGMENTS = 12
FRAMES = 3
BY_ROD = ("length", "flexibility", "stiffness", "rest", "load", "moment")
BY_FRAME = ("ends", "clamp", "direction", "offset", "compliance")


@dataclass(frozen=True)
class Case:
    """A rope in three frames; which ends and clamps hold it; a support at node 5 pulls on it."""

    held: tuple[bool, bool] = (True, True)
    clamped: tuple[bool, bool] = (True, True)
    stretchy: bool = True
    supports: bool = True
    seed: int = 0

    def build(self) -> tuple[Rod, Conditions]:
        rng = np.random.default_rng(self.seed)
        properties = uniform(
            length=1.0,
            segments=SEGMENTS,
            bend=0.05,
            twist=0.03,
            axial=40.0 if self.stretchy else np.inf,
            shear=30.0 if self.stretchy else np.inf,
            curvature=(0.6, -0.4, 1.0),
        )
        rod = build(properties, DOWN, self.clamped)
        jitter = 0.005 * rng.normal(size=(SEGMENTS + 1, 3))
        moment = 0.01 * rng.normal(size=(2, 3))
        rod = rod._replace(load=rod.load + jitter, moment=moment)
        ends = np.zeros((FRAMES, 2, 3))
        apart = 0.7 + 0.05 * rng.normal(size=(FRAMES, 3))
        ends[:, 1] = apart * np.array([1.0, 0.2, 0.1])
        tilt = 0.4 * rng.normal(size=(FRAMES, 2, 3))
        level = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # e3 to x
        clamp = multiply(from_rotation_vector(tilt), np.tile(level, (FRAMES, 2, 1)))
        for end in range(2):
            if not self.held[end]:
                ends[:, end] = np.nan
            if not self.clamped[end]:
                clamp[:, end] = np.nan
        conditions = Conditions(ends, clamp)
        if self.supports:
            across = rng.normal(size=(FRAMES, 2, 3))
            conditions = replace(
                conditions,
                node=np.array([5, 7]),
                direction=across / np.linalg.norm(across, axis=-1, keepdims=True),
                offset=0.05 * rng.normal(size=(FRAMES, 2)),
                compliance=np.tile([0.3, 0.5], (FRAMES, 1)),
                active=np.array([[True, True], [True, False], [False, True]]),
            )
        return tensors(rod), tensors(conditions)


CASES = {
    "clamped": Case(),
    "inextensible": Case(stretchy=False),
    "pinned": Case(clamped=(False, False), stretchy=False, supports=False),
    "free end 1": Case(held=(True, False), clamped=(True, False)),
    "free end 0": Case(held=(False, True), clamped=(False, True), stretchy=False),
    "free end 0, clamped there": Case(held=(False, True), clamped=(True, True)),
}


def loss_of(x: Tensor, q: Tensor) -> Tensor:
    """Weights of all entries differ, so that no error hides."""
    random = torch.Generator().manual_seed(3)
    by_x = torch.randn(x.shape, generator=random, dtype=torch.float64)
    by_q = torch.randn(q.shape, generator=random, dtype=torch.float64)
    return (by_x * x).sum() + (by_q * q).sum() + (x**2).sum()


def inputs_of(rod: Rod, conditions: Conditions) -> dict[str, Tensor]:
    found = {name: getattr(rod, name) for name in BY_ROD}
    found |= {name: getattr(conditions, name) for name in BY_FRAME}
    return {
        name: value
        for name, value in found.items()
        if value is not None and not torch.isnan(value).all()
    }


def changed(rod: Rod, conditions: Conditions, name: str, value: Tensor):
    if name in BY_ROD:
        return rod._replace(**{name: value}), conditions
    return rod, replace(conditions, **{name: value})


def direction_of(name: str, value: Tensor, seed: int = 5) -> Tensor:
    """A random change; of what is not there (a free end, no clamp) none."""
    random = torch.Generator().manual_seed(seed)
    change = torch.randn(value.shape, generator=random, dtype=torch.float64)
    typical = {
        "flexibility": 0.03,
        "rest": 0.05,
        "load": 0.05,
        "moment": 0.02,
        "length": 0.05,
        "ends": 0.2,
    }
    change = change * typical.get(name, float(torch.nanmean(value.abs())))
    if name == "stiffness":
        return torch.where(value == 0, 0.0, change)
    if name == "clamp":  # along the unit sphere
        change = change - (change * value).sum(-1, keepdim=True) * value
    return torch.where(torch.isnan(value), 0.0, change)


def difference(
    rod: Rod, conditions: Conditions, name: str, change: Tensor, start: Solution, h: float
) -> float:
    """Central difference of sixth order."""
    value = inputs_of(rod, conditions)[name]

    def at(step: float) -> float:
        moved = value + step * change
        if name == "clamp":
            moved = normalise(moved)
        s = solved(*changed(rod, conditions, name, moved), start=start, tolerance=1e-12)
        return float(loss_of(torch.from_numpy(s.x), torch.from_numpy(s.q)))

    d = [at(k * h) - at(-k * h) for k in (1, 2, 3)]
    return (45 * d[0] - 9 * d[1] + d[2]) / (60 * h)


def slope(rod: Rod, conditions: Conditions, name: str, change: Tensor, start: Solution) -> float:
    value = inputs_of(rod, conditions)[name].clone().requires_grad_()
    state, _ = settle(*changed(rod, conditions, name, value), start=start)
    (found,) = torch.autograd.grad(loss_of(*state), value)
    assert found.shape == value.shape
    return float((found * change).nansum())


@pytest.mark.parametrize("case", CASES)
def test_adjoint_is_the_derivative(case):
    rod, conditions = CASES[case].build()
    start = solved(rod, conditions, tolerance=1e-13)
    checked = []
    for name, value in inputs_of(rod, conditions).items():
        change = direction_of(name, value)
        expected = difference(rod, conditions, name, change, start, 1e-3)
        assert abs(expected) > 1e-4, name
        found = slope(rod, conditions, name, change, start)
        assert found == pytest.approx(expected, rel=1e-6), name
        checked.append(name)
    assert len(checked) == (11 if CASES[case].supports else 7)


def test_near_buckling():
    """Four parts in a thousand below the load that buckles it, a strut answers a side load 200
    times as strongly, and its derivatives still agree."""
    upright = uniform(length=1.0, segments=20, bend=1.0, twist=10.0)
    rod = tensors(build(upright, 0 * DOWN, (True, False)))
    load = rod.load.clone()
    load[-1, 2] = -0.996 * np.pi**2 / 4
    load[-1, 0], load[-1, 1] = 1e-4, 2e-4
    rod = rod._replace(load=load)
    ends = torch.zeros(1, 2, 3, dtype=torch.float64)
    ends[0, 1] = torch.nan
    clamp = torch.full((1, 2, 4), torch.nan, dtype=torch.float64)
    clamp[0, 0] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    conditions = Conditions(ends, clamp)
    start = solved(rod, conditions, tolerance=1e-13)
    assert np.abs(start.x[0, -1, :2]).max() > 100 * 2e-4 / 3  # unpushed: F L³/(3 EI)
    for name in ("length", "stiffness", "rest", "load", "clamp"):
        change = direction_of(name, inputs_of(rod, conditions)[name])
        expected = difference(rod, conditions, name, change, start, 2e-5)
        assert slope(rod, conditions, name, change, start) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("case", CASES)
def test_tangent_equals_adjoint(case):
    """Two directions at once in each input; the adjoint's gradient along them."""
    rod, conditions = CASES[case].build()
    solution = solved(rod, conditions, tolerance=1e-13)
    inputs = inputs_of(rod, conditions)
    for name in set(inputs) - {"direction", "compliance"}:
        changes = [direction_of(name, inputs[name], seed) for seed in (1, 2)]
        given = torch.stack(changes, 0)[None] if name in BY_ROD else torch.stack(changes, 1)
        if name == "clamp":  # as turns about the clamp's own axes: 2 Im(q* dq)
            clamp = conditions.clamp[:, None].expand(given.shape)
            sign = torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=torch.float64)
            given = torch.nan_to_num(2 * multiply(clamp * sign, given)[..., 1:])
        directions = Directions(**{name: given.numpy()})
        dx, turn = (torch.from_numpy(item) for item in tangent(solution, directions))
        state = settled(solution, rod, conditions)
        x, q = (item.detach().requires_grad_() for item in state)
        by_x, by_q = torch.autograd.grad(loss_of(x, q), [x, q])
        half = torch.nn.functional.pad(0.5 * turn, (1, 0))
        dq = multiply(q.detach()[:, None].expand(half.shape), half)
        found = (by_x[:, None] * dx).sum((0, 2, 3)) + (by_q[:, None] * dq).sum((0, 2, 3))
        for k, change in enumerate(changes):
            expected = slope(rod, conditions, name, change, solution)
            assert float(found[k]) == pytest.approx(expected, rel=1e-8, abs=1e-9), name


def test_several_ropes():
    """Frames that share a rope add up their gradients; `member` says who shares."""
    rod, conditions = CASES["clamped"].build()
    both = Rod(*(torch.stack([item, 1.1 * item]) for item in rod))
    member = np.array([0, 1, 0])
    value = both.stiffness.clone().requires_grad_()
    state, s = settle(both._replace(stiffness=value), conditions, member=member)
    (found,) = torch.autograd.grad(loss_of(*state), value)
    expected = torch.zeros_like(value)
    for t, k in enumerate(member):
        one = Rod(*(item[k] for item in both))
        alone, again = settle(
            one._replace(stiffness=value[k]),
            conditions.frames(np.array([t])),
            start=s.frames(t * ONE),
        )
        whole = [torch.zeros_like(item) for item in state]
        x, q = whole[0].index_copy(0, torch.tensor([t]), alone.x), whole[1]
        q = q.index_copy(0, torch.tensor([t]), alone.q)
        assert np.abs(again.x[0] - s.x[t]).max() < 1e-12
        expected += torch.autograd.grad(loss_of(x, q), value)[0]
    assert torch.allclose(found, expected, rtol=1e-9, atol=1e-12)


ONE = np.ones(1, dtype=np.int64)


def test_not_converged_is_nan():
    """A frame that did not arrive has no derivative; the others do not notice."""
    rod, conditions = CASES["pinned"].build()
    far = conditions.ends.clone()
    far[1, 1] = torch.tensor([3.0, 0.0, 0.0])
    value = rod.load.clone().requires_grad_()
    state, s = settle(rod._replace(load=value), replace(conditions, ends=far))
    assert s.converged.tolist() == [True, False, True]
    assert torch.isnan(state.x[1]).all()
    assert torch.isfinite(state.x[[0, 2]]).all()
    (found,) = torch.autograd.grad(state.x[[0, 2]].sum(), value)
    (expected,) = torch.autograd.grad(
        settle(rod._replace(load=value), conditions)[0].x[[0, 2]].sum(), value
    )
    assert torch.allclose(found, expected, rtol=1e-9)
