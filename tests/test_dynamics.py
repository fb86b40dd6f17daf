"""Ropes in motion against closed forms: pendulum, hanging chain, cantilever, damped oscillators."""

import math

import numpy as np
import pytest
from scipy import optimize, special

from ropefit.rod.moving import DRAG_SPEEDS
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import ALONG_X, DOWN, hung, in_plane, rope, stepped, turned
from tests.tensors import tensors

G = 9.81
STILL = np.zeros(3)


def pendulum(time: np.ndarray, angle: float, length: float) -> np.ndarray:
    """(T,) [rad] of a pendulum let go at an angle, by Jacobi's elliptic functions."""
    m = math.sin(angle / 2) ** 2
    quarter = special.ellipk(m)
    sn = special.ellipj(quarter - math.sqrt(G / length) * time, m)[0]
    return 2 * np.arcsin(math.sqrt(m) * sn)


def swing(time: np.ndarray, angle: float = 1.2, length: float = 0.5) -> np.ndarray:
    """(T,) [rad] the same from one rigid segment with its mass at the node."""
    p = uniform(length=length, segments=1, bend=1.0)
    x = np.array([[0.0, 0, 0], [length * math.sin(angle), 0, -length * math.cos(angle)]])
    found = stepped(rope(p), hung(time), in_plane(x)).x[0, :, 1]
    assert np.abs(np.linalg.norm(found, axis=1) - length).max() < 1e-12
    return np.arctan2(found[:, 0], -found[:, 2])


@pytest.mark.parametrize("uneven", [False, True])
def test_pendulum_at_second_order(uneven):
    errors = []
    for steps in (200, 400, 800):
        share = np.linspace(0, 1, steps + 1)
        if uneven:
            share = share + 0.05 * np.sin(2 * np.pi * 3 * share) / (2 * np.pi)
        time = 2.0 * share
        errors.append(np.abs(swing(time) - pendulum(time, 1.2, 0.5)).max())
    power = -np.polyfit(np.log([200, 400, 800]), np.log(errors), 1)[0]
    assert 1.7 < power < 2.3, errors
    assert 1e-6 < errors[-1] < 3e-3


def test_energy_drift_of_a_pendulum():
    """Over 68 swings of 1.5 s some energy is lost, none gained, and an eighth of it at half the
    step."""
    lost = []
    for step in (0.01, 0.005):
        angle = swing(np.arange(0, 100, step), 0.8)
        swings = round(1.6 / step)
        crest = np.array([np.abs(angle[:swings]).max(), np.abs(angle[-swings:]).max()])
        energy = 1 - np.cos(crest)
        lost.append(1 - energy[1] / energy[0])
    assert 0 < lost[0] < 0.07
    assert 6 < lost[0] / lost[1] < 10


def frequency(signal: np.ndarray, time: np.ndarray, guess: float) -> tuple[float, float]:
    """(ω [rad/s], decay [1/s]) of a vibration that starts from rest."""

    unit = signal / signal[0]  # small numbers look like convergence to the solver

    def gap(v):
        wave = np.cos(v[0] * time) + v[1] / v[0] * np.sin(v[0] * time)
        return np.exp(-v[1] * time) * wave - unit

    found = optimize.least_squares(gap, [guess, 0.0], x_scale=[guess, 0.1])
    assert np.abs(found.fun).max() < 0.05
    return float(found.x[0]), float(found.x[1])


def chain(mode: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Lower end (T,) and time (T,) of a vibrating hanging chain, and its ω: modes J0(2 ω sqrt(z/g))
    above the lower end, ω from the zeros of J0."""
    length, segments = 1.0, 200
    zero = special.jn_zeros(0, mode)[-1]
    omega = zero / 2 * math.sqrt(G / length)
    p = uniform(length=length, segments=segments, bend=1e-9)
    s = np.linspace(0, length, segments + 1)
    shape = special.j0(zero * np.sqrt(1 - s / length))
    x = np.stack([1e-4 * shape, 0 * s, -s], axis=1)
    time = np.arange(0, 1.5 * 2 * math.pi / omega, 2 * math.pi / omega / 400)
    return stepped(rope(p), hung(time), in_plane(x)).x[0, :, -1, 0], time, omega


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_hanging_chain(mode):
    end, time, omega = chain(mode)
    assert frequency(end, time, omega)[0] == pytest.approx(omega, rel=3e-3)


def beam_mode(mode: int, share: np.ndarray) -> tuple[np.ndarray, float]:
    """A cantilever's mode at shares of its length, and βL."""
    low, high = [(1.5, 2.2), (4.4, 5.0), (7.5, 8.1)][mode - 1]
    b = optimize.brentq(lambda v: math.cos(v) * math.cosh(v) + 1, low, high)
    z = b * share
    ratio = (math.cosh(b) + math.cos(b)) / (math.sinh(b) + math.sin(b))
    return np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z)), b


def beam(mode: int, segments: int, loss: float = 0.0) -> tuple[np.ndarray, np.ndarray, float]:
    """Tip (T,) and time (T,) of a vibrating cantilever without weight, and its ω."""
    length, bend, density = 1.0, 0.01, 0.05
    s = np.linspace(0, length, segments + 1)
    shape, b = beam_mode(mode, s / length)
    omega = b**2 * math.sqrt(bend / (density * length**4))
    p = uniform(length=length, segments=segments, bend=bend, density=density)
    edge = np.diff(1e-4 * shape)
    along = np.sqrt((length / segments) ** 2 - edge**2)
    x = np.stack([1e-4 * shape, 0 * s, np.r_[0.0, along.cumsum()]], axis=1)
    time = np.arange(0, 1.5 * 2 * math.pi / omega, 2 * math.pi / omega / 400)
    upright = np.array([1.0, 0, 0, 0])
    moved = rope(p, STILL, (True, False), bend=bend * loss)
    return stepped(moved, hung(time, upright), in_plane(x)).x[0, :, -1, 0], time, omega


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_cantilever(mode):
    tip, time, omega = beam(mode, 60)
    assert frequency(tip, time, omega)[0] == pytest.approx(omega, rel=4e-3)


def test_bending_damping():
    """A Kelvin-Voigt beam: decay ω² η/(2 EI)."""
    loss = 0.01
    tip, time, omega = beam(1, 40, loss)
    assert frequency(tip, time, omega)[1] == pytest.approx(omega**2 * loss / 2, rel=0.02)


def test_air_drag():
    """A pendulum's small swing decays with c/(2 m)."""
    length, drag = 0.5, 0.4
    p = uniform(length=length, segments=1, bend=1.0, density=0.3)
    time = np.arange(0, 4, 0.002)
    x = np.array([[0.0, 0, 0], [1e-3, 0, -math.sqrt(length**2 - 1e-6)]])
    found = stepped(rope(p, air=drag), hung(time), in_plane(x)).x[0, :, 1, 0]
    assert frequency(found, time, 4.4)[1] == pytest.approx(drag / 0.3 / 2, rel=0.01)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_drag_that_grows_as_a_power_of_speed(power):
    """A pendulum's swing A under c v^n: dA/dt = -c w^n A^n k, k the mean of |cos|^(n+1) over m."""
    length, drag, first = 0.5, 0.8, 0.06
    p = uniform(length=length, segments=1, bend=1.0, density=0.3)
    law = (power - 1) * np.log(DRAG_SPEEDS)
    moved = rope(p, air=drag)._replace(drag=law)
    time = np.arange(0, 12, 0.004)
    x = np.array([[0.0, 0, 0], [first, 0, -math.sqrt(length**2 - first**2)]])
    found = stepped(moved, hung(time), in_plane(x)).x[0, :, 1, 0]
    last = 2600 + int(np.argmax(found[2600:]))
    phase = np.linspace(0, 2 * math.pi, 2001)[:-1]
    omega, mean = math.sqrt(G / length), (np.abs(np.cos(phase)) ** (power + 1)).mean()
    lost = drag / 0.3 * omega ** (power - 1) * mean * time[last]
    expected = first * math.exp(-lost) if power == 1 else 1 / (1 / first + lost)
    assert found[last] == pytest.approx(expected, rel=0.02)


def test_a_spring_to_a_fixed_point():
    """A pendulum that a soft spring pulls sideways: its frequency and where it comes to rest."""
    length, density, stiffness = 0.5, 0.4, 0.6
    p = uniform(length=length, segments=1, bend=1.0, density=density)
    mass, time = density * length / 2, np.arange(0, 6, 0.002)
    moved = rope(p)
    spring = np.array([0.0, stiffness])
    anchor = np.array([0.02, 0.0, -length])
    load = moved.rod.load + spring[:, None] * anchor
    moved = moved._replace(spring=spring, rod=moved.rod._replace(load=load))
    found = stepped(moved, hung(time), in_plane(np.array([[0.0, 0, 0], [0, 0, -length]])))
    omega = math.sqrt(G / length + stiffness / mass)
    rest = stiffness * 0.02 / (mass * omega**2)
    expected = rest * (1 - np.cos(omega * time))
    assert np.abs(found.x[0, :, 1, 0] - expected).max() < 0.02 * rest


def test_stretch_damping():
    """A mass on a damped spring, let go unstretched."""
    length, density, axial, viscous = 0.5, 0.4, 40.0, 0.5
    p = uniform(length=length, segments=1, bend=1.0, axial=axial, density=density)
    mass = density * length / 2
    time = np.arange(0, 2, 0.001)
    x = np.array([[0.0, 0, 0], [0, 0, -length]])
    found = stepped(rope(p, stretch=viscous), hung(time), in_plane(x)).x[0, :, 1, 2]
    sag = mass * G / (axial / length)
    decay, own = viscous / length / mass / 2, math.sqrt(axial / length / mass)
    omega = math.sqrt(own**2 - decay**2)
    swing_ = np.exp(-decay * time) * (np.cos(omega * time) + decay / omega * np.sin(omega * time))
    assert np.abs(found - (-length - sag + sag * swing_)).max() < 2e-2 * sag


def bent_between_clamps(axial: float, segments: int = 16) -> tuple:
    """A curved rope between two clamps: properties, gravity's setting, ends, clamps."""
    p = uniform(
        length=1.0, segments=segments, bend=2e-3, axial=axial, density=0.06,
        curvature=(0.8, 0.5, 0.6),
    )  # fmt: skip
    ends = np.array([[0.0, 0, 0], [0.7, 0.1, 0.05]])
    turn = np.array([[0.2, 0.1, 0.4], [-0.3, 0.2, 0]])
    return p, ends, turned(ALONG_X, turn)


@pytest.mark.parametrize("axial", [math.inf, 20.0])
def test_comes_to_rest_at_the_equilibrium(axial):
    """From another equilibrium, with damping: the same state as Newton's method finds."""
    p, ends, clamp = bent_between_clamps(axial)
    still = settle(build(p, DOWN, (True, True)), Conditions(ends[None], clamp[None]))
    away = settle(build(p, 0.2 * DOWN, (True, True)), Conditions(ends[None], clamp[None]))
    time = np.arange(600)[None] * 0.05
    drive = Drive(time, np.tile(ends, (1, 600, 1, 1)), np.tile(clamp, (1, 600, 1, 1)))
    start = Start(away.x, away.q, np.zeros((1, 17, 3)))
    moved = rope(p, clamped=(True, True), bend=2e-4, twist=2e-4, stretch=0.5, air=0.1)
    found = stepped(moved, drive, start)
    assert np.abs(away.x - still.x).max() > 0.01
    assert np.abs(found.x[0, -1] - still.x[0]).max() < 1e-8
    assert np.abs(found.force[0, -1] - still.force[0]).max() < 1e-7


def test_stiff_against_stretch_at_ten_milliseconds():
    """A rope that hardly stretches moves as one that does not, at 10 ms, without damping."""
    found = []
    for axial in (math.inf, 1e6):
        p, ends, clamp = bent_between_clamps(axial)
        start = settle(build(p, DOWN, (True, True)), Conditions(ends[None], clamp[None]))
        time = np.arange(500) * 0.01
        shake = 0.1 * np.stack([0 * time, np.sin(8 * time), np.sin(5 * time)], axis=-1)
        path = ends[None, None] + np.stack([shake, 0 * shake], axis=1)[None]
        drive = Drive(time[None], path, np.tile(clamp, (1, 500, 1, 1)))
        first = Start(start.x, start.q, np.zeros((1, 17, 3)))
        found.append(stepped(rope(p, clamped=(True, True)), drive, first).x)
    assert np.abs(found[0]).max() < 2.0
    assert np.abs(found[0] - found[1]).max() < 2e-3


def test_a_pinned_rope_swung_in_space_is_stepped_quickly():
    """Nothing holds its spin: rounding must not be taken for it."""
    p = uniform(length=1.0, segments=60, bend=3e-4, density=0.05)
    time = np.arange(200) * 0.01
    slow = 0.2 * time**3
    moving = np.stack([0.1 * np.sin(slow), 0.6 + 0.2 * np.cos(slow), 0.1 * slow], axis=-1)
    path = np.stack([moving, np.zeros_like(moving)], axis=1)[None]
    clamp = np.full((1, 200, 2, 4), np.nan)
    still = settle(build(p, DOWN, (False, False)), Conditions(path[:, 0], clamp[:, 0]))
    start = Start(still.x, still.q, np.zeros_like(still.x))
    found = stepped(rope(p, air=0.05), Drive(time[None], path, clamp), start)
    assert found.iterations.max() <= 5


def test_a_spin_that_hardly_anything_resists_is_not_taken_for_motion():
    """A pinned rope, shaken, whose bending is damped by next to nothing."""
    p = uniform(length=1.0, segments=48, bend=3e-4, density=0.05)
    time = np.arange(300) * 0.005
    grown = np.minimum(time / 0.6, 1)
    grown = 0.2 * grown**3 * (10 - 15 * grown + 6 * grown**2)
    sway = [np.sin(7 * time), np.cos(9.1 * time), np.sin(4.9 * time)]
    moving = np.stack([grown * s for s in sway], axis=-1) + np.array([0.0, 0.5, 0.0])
    path = np.stack([moving, np.zeros_like(moving)], axis=1)[None]
    clamp = np.full((1, 300, 2, 4), np.nan)
    still = settle(build(p, DOWN, (False, False)), Conditions(path[:, 0], clamp[:, 0]))
    start = Start(still.x, still.q, np.zeros_like(still.x))
    assert solve(
        rope(p, air=0.01, bend=1e-8, twist=1e-8), Drive(time[None], path, clamp), start
    ).converged.all()


def test_what_cannot_be_stepped_is_said():
    """Ends pulled further apart than the rope is long."""
    p = uniform(length=1.0, segments=6, bend=1e-3)
    time = np.arange(20)[None] * 0.01
    ends = np.zeros((1, 20, 2, 3))
    ends[0, :, 1, 0] = 0.99 + 0.01 * np.arange(20)
    start = in_plane(np.linspace([0.0, 0, 0], [1.0, 0, 0], 7))
    drive = Drive(time, ends, np.full((1, 20, 2, 4), np.nan))
    found = solve(rope(p), drive, start)
    assert not found.converged[0]
    assert np.isnan(found.x[0, found.done[0] :]).all()
    with pytest.raises(ArithmeticError, match="smaller steps"):
        simulate(*tensors((rope(p), drive, start)))
