"""Ropes in motion that touch a plane or a bar: rest, impact, sliding, and exact derivatives."""

import math

import numpy as np
import pytest
import torch

from ropefit.rod.fields import BAR, BODIES, PLANE
from ropefit.rod.moving import Moving, moving
from ropefit.rod.potential import Potential
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.derivatives import Directions, tangent
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import DOWN, damping, in_plane, rope, stepped
from tests.tensors import tensors

G = 9.81
BOUND = 1e-4  # m: depth that nobody may see
TILTED = [0.05, 0.02, math.sqrt(1 - 0.05**2 - 0.02**2)]


def table(height: float, normal=(0.0, 0.0, 1.0)) -> np.ndarray:
    return np.array([[0.0, 0.0, height, *normal, 0.0, PLANE]])


def bar(x: float, z: float, radius: float) -> np.ndarray:
    return np.array([[x, 0.0, z, 0.0, 1.0, 0.0, radius, BAR]])


def touching(moved: Moving, *bodies: np.ndarray) -> Moving:
    rows = np.zeros_like(moved.bodies)
    rows[: len(bodies)] = np.concatenate(bodies)
    return moved._replace(bodies=rows)


def eased(time: np.ndarray, last: float) -> np.ndarray:
    """(T,) from 0 to 1, smooth, at rest from `last` on."""
    share = np.minimum(time / last, 1)
    return share**3 * (10 - 15 * share + 6 * share**2)


def led(first: np.ndarray, other: np.ndarray, step: float) -> Drive:
    """Both ends pinned, along paths (T, 3)."""
    time = np.arange(len(first))[None] * step
    ends = np.stack([first, other], axis=1)[None]
    return Drive(time, ends, np.full((1, len(first), 2, 4), np.nan))


def from_rest(p, drive: Drive) -> Start:
    still = settle(build(p, DOWN, (False, False)), Conditions(drive.ends[:, 0], drive.clamp[:, 0]))
    assert still.converged.all()
    return Start(still.x, still.q, np.zeros_like(still.x))


def lowered(segments: int, step: float, seconds: float, by: float) -> tuple:
    """A rope between two grips that go down."""
    p = uniform(length=1.0, segments=segments, bend=5e-4, density=0.05)
    time = np.arange(round(seconds / step)) * step
    down = -by * eased(time, 1.0)
    first = np.stack([0 * time, 0 * time, down], axis=-1)
    drive = led(first, first + np.array([0.6, 0.0, 0.0]), step)
    return p, drive, from_rest(p, drive)


@pytest.mark.parametrize("kind", ["table", "bar"])
def test_comes_to_rest_where_the_equilibrium_is(kind):
    p, drive, start = lowered(30, 0.01, 24.0, 0.15)
    start.v[:, 1:-1, 1] = 0.02  # on a table it lies in a bow, to either side
    body = table(-0.4) if kind == "table" else bar(0.3, -0.69, 0.2)
    found = stepped(touching(rope(p, bend=2e-5, twist=2e-5, air=0.4), body), drive, start)
    x = found.x[0]
    lying = x[-1, :, 2] + 0.4 < 1e-5 if kind == "table" else _gap(body, x[-1]) < 1e-5
    assert lying.sum() >= (10 if kind == "table" else 1)

    still = solve_with_potentials(
        build(p, DOWN, (False, False)), Conditions(drive.ends[:, -1], drive.clamp[:, -1]),
        (potential(body, 31),),
    )  # fmt: skip
    assert still.converged.all()
    same, mirrored = (np.abs(still.x[0] * [1, side, 1] - x[-1]).max() for side in (1, -1))
    assert min(same, mirrored) < 2e-5


def potential(body: np.ndarray, nodes: int, hard: float = 2e4) -> Potential:
    """The same body for a rope at rest, of a hardness [N/m]."""
    row = body[0]

    def energy(x: np.ndarray) -> np.ndarray:
        return 0.5 * hard * np.minimum(_gap(body, x), 0.0) ** 2

    def derivatives(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normal, curvature = np.broadcast_to(row[3:6], x.shape), np.zeros((*x.shape, 3))
        if row[7] == BAR:
            across = np.eye(3) - np.outer(row[3:6], row[3:6])
            far = (_gap(body, x) + row[6])[..., None]
            normal = (x - row[:3]) @ across / far
            curvature = (across - normal[..., None] * normal[..., None, :]) / far[..., None]
        inside = np.minimum(_gap(body, x), 0.0)[..., None]
        square = (inside < 0)[..., None] * normal[..., None] * normal[..., None, :]
        return hard * inside * normal, hard * (square + inside[..., None] * curvature)

    return Potential(energy, np.ones(nodes), np.array(hard), derivatives=derivatives)


def _gap(body: np.ndarray, x: np.ndarray) -> np.ndarray:
    row = body[0]
    away = x - row[:3]
    along = away @ row[3:6]
    if row[7] == PLANE:
        return along
    return np.linalg.norm(away - along[..., None] * row[3:6], axis=-1) - row[6]


def dropped(segments: int, height: float, body: np.ndarray, tilt=0.0, speed=0.0, step=0.005):
    """A free short rope, let fall from a height, turned by an angle [rad] and perhaps thrown."""
    p = uniform(length=0.2, segments=segments, bend=1e-3, density=0.05)
    s = np.linspace(-0.1, 0.1, segments + 1)
    x = np.stack([s * math.cos(tilt), 0 * s, height + s * math.sin(tilt)], axis=1)
    none = np.full((1, 160, 2, 3), np.nan)
    time = np.arange(160)[None] * step
    drive = Drive(time, none, np.full((1, 160, 2, 4), np.nan))
    v = np.zeros_like(x)
    v[:, 0] = speed
    return touching(rope(p, bend=1e-6, twist=1e-6), body), drive, in_plane(x, v)


def mechanical(moved: Moving, found: Trajectory) -> np.ndarray:
    """(T,) [J] kinetic and potential energy, that of bending left out; speeds between two times."""
    x, time = found.x[0], found.problem.drives.time[0]
    v = np.diff(x, axis=0) / np.diff(time)[:, None, None]
    mass = moved.mass
    kinetic = 0.5 * (mass[:, None] * v**2).sum((1, 2))
    return kinetic + G * (mass * 0.5 * (x[1:, :, 2] + x[:-1, :, 2])).sum(1)


@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_dropped_rope_stays_where_it_falls(speed):
    """It falls freely, hits the table flat, does not bounce, and goes on sliding."""
    moved, drive, start = dropped(6, 0.5, table(0.0), speed=speed)
    found = stepped(moved, drive, start)
    x, weight = found.x[0], G * float(moved.mass.sum())
    assert x[..., 2].min() > -BOUND
    assert np.abs(x[-1, :, 2]).max() < 1e-6
    energy = mechanical(moved, found)
    impact = int(np.flatnonzero(x[:, :, 2].min(1) < 0)[0])
    assert math.sqrt(2 * 0.5 / G) == pytest.approx(impact * 0.005, abs=0.011)
    falling = weight * 0.5 + 0.5 * float(moved.mass.sum()) * speed**2
    assert energy[: impact - 1] == pytest.approx(falling, rel=0.02)
    assert np.diff(energy).max() < 1e-3 * weight
    assert x[impact + 3 :, :, 2].max() < 0.002  # no bounce
    along = (x[-1, :, 0] - x[-2, :, 0]) / 0.005
    assert along == pytest.approx(speed, rel=0.02, abs=1e-9)


def test_a_rope_that_falls_askew_gains_no_energy():
    moved, drive, start = dropped(8, 0.4, table(0.0), tilt=0.6)
    found = stepped(moved, drive, start)
    weight = G * float(moved.mass.sum())
    assert found.x[..., 2].min() > -BOUND
    assert np.diff(mechanical(moved, found)).max() < 0.01 * weight * 0.4


def test_a_rope_over_a_bar_slides_off_to_the_heavier_side():
    body = bar(0.03, 0.0, 0.05)
    moved, drive, start = dropped(16, 0.08, body)
    found = stepped(moved, drive, start)
    assert _gap(body, found.x[0]).min() > -BOUND
    assert (_gap(body, found.x[0]) < 0).any()
    assert found.x[0, -1, :, 2].max() < -0.5  # fallen past it
    assert found.x[0, -1, :, 0].mean() < 0.0


def test_a_chain_dragged_over_a_table_follows_its_end():
    """Its other end is free; without friction it hangs behind, and never sinks in."""
    p = uniform(length=1.0, segments=30, bend=2e-4, density=0.05)
    time = np.arange(500) * 0.01
    first = np.stack([0.5 * np.minimum(time, 3), 0 * time, 0.3 + 0 * time], axis=-1)
    first[:, 0] = 1.2 * eased(time, 3.0)
    drive = led(first, first, 0.01)
    drive.ends[:, :, 1] = np.nan
    s = np.linspace(0, 1, 31)
    x = np.stack([0 * s, 0 * s, 0.3 - s], axis=1)
    low = x[:, 2] < 0.0  # what would be under the table lies on it
    x[low, 0], x[low, 2] = x[low, 2], 0.0
    moved = touching(rope(p, bend=2e-5, twist=2e-5, air=0.05), table(0.0))
    found = stepped(moved, drive, in_plane(x))
    assert found.x[..., 2].min() > -BOUND
    assert (found.x[0, -1, :, 2] < 1e-6).sum() >= 15
    lengths = np.linalg.norm(np.diff(found.x[0, -1], axis=0), axis=-1)
    assert np.abs(lengths - 1 / 30).max() < 1e-9


NAMES = ("EI", "density", "length", "spring", "air damping", "ends", "first speed",
         "plane", "bar", "radius")  # fmt: skip


def changed(amounts: dict[str, torch.Tensor]) -> tuple[Moving, Drive, Start]:
    """A rope that is swung against a sloped table and a bar, some of it changed."""
    a = {name: amounts.get(name, torch.zeros((), dtype=torch.float64)) for name in NAMES}
    random = np.random.default_rng(5)

    def noise(*shape: int) -> torch.Tensor:
        return torch.from_numpy(random.normal(size=shape))

    p, drive, start = tensors(lowered(12, 0.01, 1.2, 0.15))
    p = p._replace(
        bend=p.bend * torch.exp(a["EI"] * noise(12)), length=p.length * torch.exp(a["length"]),
        density=p.density * torch.exp(a["density"] * noise(12)),
    )  # fmt: skip
    grown = drive.time[0, :, None, None]
    shake = 0.1 * grown * torch.sin(7 * grown + torch.arange(6).reshape(2, 3))
    drive = drive._replace(ends=drive.ends + shake + a["ends"] * grown * noise(120, 2, 3))
    inner = torch.ones(13, 1, dtype=torch.float64)
    inner[0], inner[-1] = 0.0, 0.0
    start = start._replace(v=start.v + inner * a["first speed"] * noise(13, 3))
    bodies = torch.from_numpy(np.concatenate([table(-0.4, TILTED), bar(0.32, -0.54, 0.18)]))
    by = torch.zeros(2, 8, dtype=torch.float64)
    by = by + a["plane"] * torch.nn.functional.pad(noise(1, 6), (0, 2, 0, 1))
    by = by + a["bar"] * torch.nn.functional.pad(noise(1, 6), (0, 2, 1, 0))
    by = by + a["radius"] * torch.tensor([[0.0] * 8, [0.0] * 6 + [1.0, 0.0]])
    bodies = bodies + by
    kinds = bodies[:, 7:]
    axes = bodies[:, 3:6] / bodies[:, 3:6].norm(dim=-1, keepdim=True)
    bodies = torch.cat([bodies[:, :3], axes, bodies[:, 6:7], kinds], dim=-1)
    spring = 0.05 + a["spring"] * torch.cos(torch.arange(13, dtype=torch.float64))
    damped = damping(p, bend=2e-5, twist=2e-5, air=0.05)
    damped = damped._replace(air=damped.air * torch.exp(a["air damping"] * noise(12)))
    rod = build(p, DOWN, (False, False))
    drag = 0.3 * torch.linspace(-1, 1, 11, dtype=torch.float64)
    return moving(p, rod, damped, drag=drag, spring=spring, bodies=bodies), drive, start


def test_both_bodies_are_touched_in_the_test_of_derivatives():
    moved, drive, start = changed({})
    x = stepped(moved, drive, start).x[0]
    for row in moved.bodies.numpy():
        inside = _gap(row[None], x) < 0
        assert 30 < inside.sum() < 800
        assert np.abs(np.diff(inside.astype(int), axis=0)).sum() > 4  # comes and goes


def test_adjoint_against_differences():
    weights = torch.from_numpy(np.random.default_rng(7).normal(size=(120, 13, 3)))
    zeros = {name: torch.zeros((), dtype=torch.float64, requires_grad=True) for name in NAMES}

    def value(amounts: dict[str, torch.Tensor]) -> torch.Tensor:
        x, _, _ = simulate(*changed(amounts))
        return (weights * x).sum()

    found = torch.autograd.grad(value(zeros), list(zeros.values()))
    for name, gradient in zip(NAMES, found, strict=True):
        errors = []
        for h in (1e-5, 3e-6, 1e-6):
            low, high = (
                float(value({name: torch.tensor(s, dtype=torch.float64)})) for s in (-h, h)
            )
            errors.append(abs((high - low) / (2 * h) - float(gradient)) / abs(float(gradient)))
        assert min(errors) < 1e-5, (name, float(gradient), errors)


def test_tangent_is_the_adjoint_turned_round():
    moved, drive, start = changed({})
    trajectory = solve(moved, drive, start)
    random = np.random.default_rng(3)
    weights = random.normal(size=trajectory.x.shape)
    leaves = {
        "load": moved.rod.load, "mass": moved.mass, "air": moved.air, "drag": moved.drag,
        "spring": moved.spring, "bodies": moved.bodies,
    }  # fmt: skip
    leaves = {name: leaf.detach().clone().requires_grad_() for name, leaf in leaves.items()}
    rod = moved.rod._replace(load=leaves["load"])
    others = {name: leaf for name, leaf in leaves.items() if name != "load"}
    x, _, _ = simulate(moved._replace(rod=rod, **others), drive, start)
    gradients = torch.autograd.grad((torch.from_numpy(weights) * x).sum(), list(leaves.values()))
    for (name, leaf), gradient in zip(leaves.items(), gradients, strict=True):
        step = random.normal(size=leaf.shape)
        dx = tangent(trajectory, Directions(**{name: step[None, None]}))
        expected = float((gradient.numpy() * step).sum())
        assert (weights * dx[:, 0]).sum() == pytest.approx(expected, rel=1e-8), name


def test_what_touches_nothing_moves_as_if_there_were_nothing():
    p, drive, start = lowered(20, 0.01, 1.5, 0.1)
    free = rope(p, bend=2e-5, twist=2e-5, air=0.05)
    far = touching(free, table(-2.0), bar(0.3, -1.5, 0.1))
    assert np.array_equal(stepped(free, drive, start).x, stepped(far, drive, start).x)


def test_more_bodies_than_can_be_touched_are_refused():
    p = uniform(length=1.0, segments=4, bend=1e-3)
    rod = build(p, DOWN, (False, False))
    with pytest.raises(ValueError, match="can touch"):
        moving(p, rod, damping(p), bodies=np.zeros((BODIES + 1, 8)))
