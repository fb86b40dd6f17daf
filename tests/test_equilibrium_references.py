"""Equilibria against closed forms and boundary-value solutions, at second order in the segments."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from reference_simulators.as_ropefit import guess_of, planar
from reference_simulators.closed_forms import catenary, hanging_bar, helix
from reference_simulators.planar_elastica import Planar, elastica
from reference_simulators.rod_energy import energy
from ropefit.rod.rod import build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from tests.rods import DOWN, NOT_HELD, Order, solved
from tests.tensors import tensors

SEGMENTS = (40, 80, 160)
NO_GRAVITY = np.zeros(3)

PLANAR = {
    "pinned": Planar(1.0, 2e-4, 1.0, far=(0.6, 0.1)),
    "pinned stretchy": Planar(0.7, 1e-2, 2.0, axial=30.0, shear=20.0, far=(0.5, -0.2)),
    "cantilever": Planar(1.0, 0.02, 1.0, first=0.5),
    "two clamps": Planar(1.0, 0.02, 1.0, far=(0.5, -0.1), first=-1.2, last=0.7),
    "one clamp, one pin": Planar(1.0, 0.02, 1.0, far=(0.5, -0.1), last=0.7),
    "end force": Planar(1.0, 0.1, 0.5, first=0.5, force=(-0.3, 0.6)),
    "end moment": Planar(1.0, 0.1, 0.5, first=0.5, moment=0.1),
    "stretchy, sheared, bent": Planar(
        1.0, 0.05, 1.0, axial=20.0, shear=8.0, curvature=1.5, first=0.5, force=(1.0, 0.0)
    ),
}


def error_of(case: Planar, segments: int) -> float:
    """Largest distance [m] of a node from where the reference has its arc length."""
    rod, conditions = planar(case, segments)
    solution = solved(rod, conditions)
    expected, _ = elastica(case, guess_of(rod, solution), rod.arc)
    assert np.abs(solution.x[0, :, 1]).max() < 1e-9
    return float(np.linalg.norm(solution.x[0][:, [0, 2]] - expected, axis=1).max())


@pytest.mark.parametrize("name", PLANAR)
def test_heavy_elastica(name):
    order = Order(SEGMENTS, tuple(error_of(PLANAR[name], n) for n in SEGMENTS))
    order.check()
    assert 1e-6 < order.errors[-1] < 5e-4


def test_accuracy_of_a_hanging_rope():
    """A pinned rope, EI = 2e-4 ρ g L³; ends nearer than this bend it more sharply
    and cost proportionally more (docs/results.md has all distances)."""
    case = Planar(1.0, 2e-4, 1.0, far=(0.65, 0.0))
    for nodes, most in ((20, 7e-4), (40, 2e-4), (100, 3e-5)):
        assert 0.5 * most < error_of(case, nodes - 1) <= most


def test_units():
    """A rope twice as long, eight times as heavy and 128 times as stiff hangs alike."""
    first, second = (
        Planar(1.0, 0.02, 1.0, far=(0.5, -0.1), first=-1.2, last=0.7),
        Planar(2.0, 1.28, 8.0, far=(1.0, -0.2), first=-1.2, last=0.7),
    )
    x = [solved(*planar(case, 24, density=d)).x for case, d in ((first, 1.0), (second, 3.0))]
    assert np.abs(2 * x[0] - x[1]).max() < 1e-9


@pytest.mark.parametrize("stretch", [0.0, 0.05])
def test_catenary(stretch):
    """Without bending stiffness; the elastic one stretches by up to 5 %."""
    axial = math.inf if stretch == 0 else 1.0 / stretch
    case = Planar(1.0, 1e-9, 1.0, axial=axial, far=(0.6, 0.2))

    def error(segments: int) -> float:
        rod, conditions = planar(case, segments)
        expected = catenary(1.0, (0.6, 0.2), rod.arc, stretch)
        return float(
            np.linalg.norm(solved(rod, conditions).x[0][:, [0, 2]] - expected, axis=1).max()
        )

    Order(SEGMENTS, tuple(error(n) for n in SEGMENTS)).check()


@pytest.mark.parametrize("end", [0, 1])
def test_hanging_bar(end):
    """Straight down from either end: exact at the nodes, the tension being linear in s."""
    rod = build(
        uniform(length=0.8, segments=11, bend=0.01, axial=5.0, density=2.0), DOWN, (False, False)
    )
    ends = np.full((1, 2, 3), np.nan)
    ends[0, end] = 0.0
    x = solved(rod, Conditions(ends, NOT_HELD)).x[0]
    depth = hanging_bar(2.0, 5.0, 0.8, rod.arc)
    assert depth[-1] > 1.1 * 0.8
    found = -x[:, 2] if end == 0 else -x[::-1, 2]
    assert np.abs(found - depth).max() < 1e-12
    assert np.abs(x[:, :2]).max() < 1e-12


def held_at_one_end(segments: int, **properties) -> tuple:
    rod = build(uniform(length=1.0, segments=segments, **properties), NO_GRAVITY, (True, False))
    ends = np.zeros((1, 2, 3))
    ends[0, 1] = np.nan
    clamp = NOT_HELD.copy()
    clamp[0, 0] = np.array([1.0, 0.0, 0.0, 0.0])
    return rod, Conditions(ends, clamp)


def test_helix():
    """Rest curvature and twist, clamped at one end, without gravity: no moment anywhere."""

    def error(segments: int) -> float:
        rod, conditions = held_at_one_end(
            segments, bend=0.3, twist=0.1, density=1.0, curvature=(4.0, 0.0, 6.0)
        )
        solution = solved(rod, conditions)
        assert np.abs(solution.force).max() == 0
        return float(np.abs(solution.x[0] - helix(4.0, 6.0, rod.arc)).max())

    Order(SEGMENTS, tuple(error(n) for n in SEGMENTS)).check()


def test_end_moment_bends_into_a_circle():
    """A moment EI/r at the end of a weightless cantilever, r = 0.5 m."""

    def error(segments: int) -> float:
        rod, conditions = held_at_one_end(segments, bend=0.3, density=1.0)
        moment = rod.moment.copy()
        moment[1, 1] = 0.3 / 0.5
        s = rod.arc
        circle = 0.5 * np.stack([1 - np.cos(s / 0.5), 0 * s, np.sin(s / 0.5)], axis=1)
        x = solved(rod._replace(moment=moment), conditions).x[0]
        return float(np.abs(x - circle).max())

    Order(SEGMENTS, tuple(error(n) for n in SEGMENTS)).check()


def test_moment_on_the_first_segment():
    """Free at end 0, clamped at end 1: the mirror image of a moment on the last segment."""
    rod, conditions = held_at_one_end(20, bend=0.3, density=1.0)
    moment = np.zeros((1, 2, 3))
    moment[0, 1, 1] = 0.4
    x = solved(rod._replace(moment=moment), conditions).x[0]
    turned = build(
        uniform(length=1.0, segments=20, bend=0.3, density=1.0), NO_GRAVITY, (False, True)
    )
    # Half a turn about x: end 1 is clamped where end 0 was, looking the other way.
    clamp = NOT_HELD.copy()
    clamp[0, 1] = np.array([0.0, 1.0, 0.0, 0.0])
    ends = np.zeros((1, 2, 3))
    ends[0, 0] = np.nan
    mirrored = solved(turned._replace(moment=moment[:, ::-1]), Conditions(ends, clamp)).x[0]
    assert abs(x[-1, 0]) > 0.1
    assert np.abs(mirrored[::-1] - x).max() < 1e-9


def test_uniform_twist():
    """A straight rope between clamps that are turned against each other by 2 rad, and by 2 rad and
    a whole turn: every element the same, and the moment GJ φ/L at second order."""
    angle = 2.0
    for turns in (0, 1):
        errors = []
        for segments in SEGMENTS:
            rod = build(
                uniform(length=1.0, segments=segments, bend=0.5, twist=0.2, axial=100.0),
                NO_GRAVITY,
                (True, True),
            )
            ends = np.zeros((1, 2, 3))
            ends[0, 1, 2] = 1.0
            clamp = np.zeros((1, 2, 4))
            clamp[0, 0, 0], clamp[0, 1, 0], clamp[0, 1, 3] = 1.0, math.cos(1.0), math.sin(1.0)
            solution = solved(rod, Conditions(ends, clamp), turns=np.array([float(turns)]))
            q = solution.q[0]
            assert np.abs(solution.x[0, :, :2]).max() < 1e-12
            step = np.unwrap(2 * np.arctan2(q[:, 3], q[:, 0]), period=2 * math.pi)
            assert np.ptp(np.diff(step)) < 1e-9
            # dE/dφ of k/2 sin²(φ/2), k = 4 GJ/l.
            moment = 0.2 * segments * math.sin(step[1] - step[0])
            whole = angle + 2 * math.pi * turns
            errors.append(abs(moment / (0.2 * whole) - 1))
        Order(SEGMENTS, tuple(errors)).check()


@pytest.mark.parametrize("name", ["pinned stretchy", "stretchy, sheared, bent", "two clamps"])
def test_energy_is_stationary(name):
    """The readable energy (rod_energy.py), which the compiled code never calls."""
    case = PLANAR[name]
    if math.isinf(case.axial):
        case = replace(case, axial=500.0, shear=300.0)
    rod, conditions = planar(case, 14)
    tilted = np.array([0.1, 0.3, 0.0]) * np.linalg.norm(rod.load, axis=-1)[..., None]
    rod = rod._replace(load=rod.load + tilted)
    solution = solved(rod, conditions)
    held = [True, *[False] * 13, case.far is not None]
    x, q = torch.from_numpy(solution.x[0]), torch.from_numpy(solution.q[0])
    clamp = torch.from_numpy(np.nan_to_num(conditions.clamp[0], nan=0.5))
    given = tensors(rod)

    def value(move: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
        frames = q + turn
        return energy(given, x + move, frames / frames.norm(dim=-1, keepdim=True), clamp)

    zero = torch.zeros_like(x).requires_grad_(), torch.zeros_like(q).requires_grad_()
    by_x, by_q = torch.autograd.grad(value(*zero), zero)
    weight = float(np.linalg.norm(rod.load, axis=-1).sum())
    assert float(by_x[~torch.tensor(held)].abs().max()) < 1e-9 * weight
    assert float(by_q.abs().max()) < 1e-9 * weight * case.length
    # The test can fail: a state a little off is told apart.
    bent = zero[0].detach().clone()
    bent[5, 2] = 1e-5
    off = torch.autograd.grad(value(bent.requires_grad_(), zero[1]), bent)[0]
    assert float(off[5].abs().max()) > 1e-6 * weight
