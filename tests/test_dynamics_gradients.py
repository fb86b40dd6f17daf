"""Derivatives of motions: the adjoint against central differences, the tangent against the
adjoint."""

import functools
import math

import numpy as np
import pytest
import torch

from ropefit.rod.moving import DRAG_SPEEDS, Damping, Moving, moving
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.derivatives import Directions, tangent
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import ALONG_X, DOWN, turned
from tests.tensors import tensors

SEGMENTS = 12
NAMES = (
    "EA", "EI", "GJ", "density", "length", "bend damping", "twist damping", "stretch damping",
    "spring", "air damping", "drag", "curvature", "gravity", "ends", "clamps", "first position",
    "first velocity", "first turn",
)  # fmt: skip


@functools.cache
def case(steps: int, clamped: tuple[bool, bool], axial: float) -> tuple:
    """Properties, drive and start of a rope that is shaken and twisted."""
    p = uniform(
        length=1.0, segments=SEGMENTS, bend=1e-3, axial=axial, density=0.06,
        curvature=(0.3, 0.2, 0.1),
    )  # fmt: skip
    time = np.arange(steps) * 0.01
    nod = 0.15 * (1 - np.cos(math.pi * time))
    first = np.stack([nod, 0.1 * np.sin(3 * time), 0 * time], axis=-1)
    last = np.stack([0.7 - 0.5 * nod, 0 * time, 0.1 * np.sin(5 * time)], axis=-1)
    ends = np.stack([first, last], axis=1)[None]
    turn = np.stack([0.3 * np.sin(4 * time), 0 * time, 0.5 * np.sin(2 * time)], axis=-1)
    clamp = turned(ALONG_X, np.stack([turn, 0 * turn], axis=1))[None]
    clamp = np.where(np.array(clamped)[:, None], clamp, np.nan)
    rod = build(p, DOWN, clamped)
    rest = settle(rod, Conditions(ends[:, 0], clamp[:, 0]))
    assert rest.converged.all()
    start = Start(rest.x, rest.q, np.zeros_like(rest.x))
    return tensors((p, Drive(time[None], ends, clamp), start))


def changed(
    amounts: dict[str, torch.Tensor], steps: int, clamped=(True, True), axial=30.0
) -> tuple[Moving, Drive, Start]:
    """The case with some of it changed, each in a direction of its own."""
    p, drive, start = case(steps, clamped, axial)
    a = {name: amounts.get(name, torch.zeros((), dtype=torch.float64)) for name in NAMES}
    random = np.random.default_rng(1)

    def noise(*shape: int) -> torch.Tensor:
        return torch.from_numpy(random.normal(size=shape))

    p = p._replace(
        axial=p.axial * torch.exp(a["EA"]) if math.isfinite(axial) else p.axial,
        bend=p.bend * torch.exp(a["EI"] * noise(SEGMENTS)),
        twist=p.twist * torch.exp(a["GJ"] * noise(SEGMENTS)),
        density=p.density * torch.exp(a["density"] * noise(SEGMENTS)),
        length=p.length * torch.exp(a["length"]),
        curvature=p.curvature + a["curvature"] * noise(SEGMENTS, 3),
    )
    coefficients = (2e-5, 2e-5, 0.5, 0.01)
    names = ("bend damping", "twist damping", "stretch damping", "air damping")
    damped = Damping(
        *(c * torch.exp(a[n] * noise(SEGMENTS)) for c, n in zip(coefficients, names, strict=True))
    )
    rod = build(p, torch.from_numpy(DOWN) + a["gravity"] * noise(3), clamped)
    # A law in which the speed matters.
    speeds = torch.from_numpy(DRAG_SPEEDS)
    drag = 0.6 * torch.log(speeds) + a["drag"] * torch.sin(5 * speeds)
    wander = noise(steps, 2, 3).cumsum(0) * torch.linspace(0, 1, steps)[:, None, None] * 0.03
    twist = noise(steps, 2, 3).cumsum(0) * 0.03
    inner = torch.ones(SEGMENTS + 1, 1, dtype=torch.float64)
    inner[0], inner[-1] = 0.0, 0.0
    drive = drive._replace(
        ends=drive.ends + a["ends"] * wander,
        clamp=turned(drive.clamp, (a["clamps"] * twist)[None]),
    )
    start = Start(
        start.x + 0.1 * a["first position"] * inner * noise(SEGMENTS + 1, 3),
        turned(start.q, 0.1 * (a["first turn"] * noise(SEGMENTS, 3))[None]),
        start.v + a["first velocity"] * inner * noise(SEGMENTS + 1, 3),
    )
    spring = 0.05 + a["spring"] * 0.1 * torch.cos(torch.arange(SEGMENTS + 1, dtype=torch.float64))
    return moving(p, rod, damped, drag=drag, spring=spring), drive, start


@pytest.mark.parametrize("steps", [10, 100, 500])
def test_adjoint_against_differences(steps):
    weights = torch.from_numpy(np.random.default_rng(7).normal(size=(steps + 1, 13, 3)))
    q_weights = torch.from_numpy(np.random.default_rng(8).normal(size=(steps + 1, 12, 4)))
    zeros = {name: torch.zeros((), dtype=torch.float64, requires_grad=True) for name in NAMES}

    def value(amounts: dict[str, torch.Tensor]) -> torch.Tensor:
        x, q, _ = simulate(*changed(amounts, steps + 1))
        return (weights * x).sum() + (q_weights * q).sum()

    found = torch.autograd.grad(value(zeros), list(zeros.values()))
    for name, gradient in zip(NAMES, found, strict=True):
        errors = []
        for h in (1e-3, 1e-4, 1e-5):

            def at(s: float, name: str = name) -> float:
                return float(value({name: torch.tensor(s, dtype=torch.float64)}))

            slope = (8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h)
            errors.append(abs(slope - float(gradient)) / abs(slope))
        assert min(errors) < 1e-6, (name, float(gradient), errors)


@pytest.mark.parametrize(
    ("clamped", "axial"),
    [((True, True), 30.0), ((True, False), math.inf), ((False, False), math.inf)],
)
def test_tangent_is_the_adjoint_turned_round(clamped, axial):
    """<weights, dx> is the same from both, for every input in a random direction."""
    steps = 60
    random = np.random.default_rng(3)
    rope_, drive, start = changed({}, steps, clamped, axial)
    trajectory = solve(rope_, drive, start)
    fields = [
        rope_.rod.length, rope_.rod.flexibility, rope_.strain_viscosity, rope_.rod.stiffness,
        rope_.bend_viscosity, rope_.rod.rest, rope_.rod.load, rope_.mass, rope_.spring,
        rope_.air, rope_.drag, rope_.bodies, drive.ends, drive.clamp, start.x, start.v, start.q,
    ]  # fmt: skip
    leaves = [f.detach().clone().requires_grad_() for f in fields]
    (
        length,
        flexibility,
        strain_viscosity,
        stiffness,
        bend_viscosity,
        rest,
        load,
        mass,
        spring,
        air,
        drag,
        bodies,
        ends,
        clamp,
        x0,
        v0,
        q0,
    ) = leaves
    rod = rope_.rod._replace(
        length=length, flexibility=flexibility, stiffness=stiffness, rest=rest, load=load
    )
    x, _, _ = simulate(
        Moving(rod, strain_viscosity, bend_viscosity, mass, spring, air, drag, bodies),
        Drive(drive.time, ends, clamp),
        Start(x0, q0, v0),
    )
    weights = random.normal(size=x.shape)
    gradients = torch.autograd.grad((torch.from_numpy(weights) * x).sum(), leaves)
    for number, (name, leaf, gradient) in enumerate(
        zip(Directions._fields, leaves, gradients, strict=True)
    ):
        by_clip = number >= 12
        turn = name in ("clamp", "q0")
        shape = (*leaf.shape[:-1], 3) if turn else leaf.shape
        step = random.normal(size=shape)
        if name in ("stiffness", "bend_viscosity"):
            step = step * (leaf.detach().numpy() != 0)
        wide = step[:, None] if by_clip else step[None, None]
        dx = tangent(trajectory, Directions(**{name: wide}))
        some = tangent(trajectory, Directions(**{name: wide}), every=3)
        assert np.array_equal(some, dx[:, :, ::3])
        moved = step
        if turn:
            q = leaf.detach()
            delta = torch.from_numpy(step)
            moved = ((turned(q, 1e-6 * delta) - turned(q, -1e-6 * delta)) / 2e-6).numpy()
            moved = np.nan_to_num(moved)
        expected = float((gradient.numpy() * moved).sum())
        assert (weights * dx[:, 0]).sum() == pytest.approx(expected, rel=1e-7, abs=1e-12), name


def test_clips_are_solved_apart():
    """Two clips of two ropes at once are what each is alone, gradients too."""
    one, two = changed({}, 40), changed({"EI": torch.tensor(0.3), "ends": torch.tensor(0.2)}, 40)

    def stack(a, b):
        return type(a)(*(stack(x, y) if isinstance(x, tuple) else torch.stack([x, y])
                         for x, y in zip(a, b, strict=True)))  # fmt: skip

    def joined(a, b):
        return type(a)(*(torch.cat([x, y]) for x, y in zip(a, b, strict=True)))

    both = solve(stack(one[0], two[0]), joined(one[1], two[1]), joined(one[2], two[2]))
    for k, alone in enumerate((one, two)):
        assert np.array_equal(both.x[k], solve(*alone).x[0])
    mass = stack(one[0], two[0]).mass.requires_grad_()
    x, _, _ = simulate(
        stack(one[0], two[0])._replace(mass=mass), joined(one[1], two[1]), joined(one[2], two[2])
    )
    (slope,) = torch.autograd.grad((x[1] ** 2).sum(), mass)
    assert (slope[0] == 0).all()
    assert (slope[1] != 0).any()
