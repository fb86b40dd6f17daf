"""Random inextensible or stretchy ropes, placements of their ends and motions, from a seed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ropefit.rod.moving import DRAG_SPEEDS, Damping, Moving, moving
from ropefit.rod.quaternion import from_rotation_vector, multiply, normalise
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle

NEAREST, FARTHEST = 0.02, 0.999  # m, of the ends of a rope of 1 m
DOWN = np.array([0.0, 0.0, -9.81])
DENSITY = 0.06  # kg/m
STOP = 0.6  # share of the time after which the ends stand still


class Placements(NamedTuple):
    """F ropes, each in one frame; bend (F,) is EI/(ρ g L³), apart (F,) |a-b|/L."""

    rod: Rod
    conditions: Conditions
    bend: np.ndarray
    apart: np.ndarray


def placements(count: int, clamped: bool, nodes: int = 20, seed: int = 0) -> Placements:
    """Draw inextensible ropes of 1 m and 1 N.

    Ends 0.02 to 0.999 m apart in any direction, EI 1e-6 to 1e-1 N m² (logarithmically uniform),
    clamps in any orientation.
    """
    rng = np.random.default_rng(seed)
    apart, bend = rng.uniform(0.02, 0.999, count), 10 ** rng.uniform(-6, -1, count)
    direction = rng.normal(size=(count, 3))
    ends = np.zeros((count, 2, 3))
    ends[:, 1] = apart[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    clamp = np.full((count, 2, 4), np.nan)
    if clamped:
        clamp = normalise(rng.normal(size=(count, 2, 4)))
    properties = uniform(length=1.0, segments=nodes - 1, bend=bend)
    rod = build(properties, np.array([0.0, 0.0, -1.0]), (clamped, clamped))
    return Placements(rod, Conditions(ends, clamp), bend, apart)


class Motions(NamedTuple):
    """C ropes that move; rest: the step from which their ends stand still."""

    rope: Moving
    drive: Drive
    start: Start
    rest: int


def motions(count: int, ends: str, stretchy: bool, nodes: int, steps: int, seed: int) -> Motions:
    """Draw ropes of 1 m and 60 g, moved from an equilibrium and then held still.

    ends: pinned, clamped, or hung (clamped at one end, the other let go). Steps of 1 to 50 ms, each
    up to 30 % longer or shorter; paths of up to half a radian and a quarter of a metre at up to
    3 Hz; EI 1e-6 to 1e-1 of the weight, bent at rest in a half of those that are clamped; damping
    of bends 1e-4 to 1e-1 s and air up to 1 N s/m², none in a quarter each. Stretchy: EA 10 to
    1e5 N.
    """
    rng = np.random.default_rng(seed)
    clamped = {"pinned": (False, False), "clamped": (True, True), "hung": (True, False)}[ends]

    def per_rope(low: float, high: float) -> np.ndarray:
        return 10 ** rng.uniform(low, high, count)

    stride = per_rope(-3, math.log10(0.05))[:, None] * rng.uniform(0.7, 1.3, (count, steps))
    time = np.cumsum(stride, axis=1) - stride[:, :1]
    rest = round(STOP * steps)
    share = np.minimum(time / time[:, rest : rest + 1], 1.0)
    warped = time[:, rest : rest + 1] * share**2 * (3 - 2 * share)
    way = paths(rng, count, warped, per_rope(-2, math.log10(0.5)), 3.0)
    held, clamp = way.ends.copy(), way.clamp.copy()
    for end in range(2):
        if not clamped[end]:
            clamp[:, :, end] = np.nan

    bend = per_rope(-6, -1) * DENSITY * 9.81
    curvature = rng.normal(0, 1, (count, 3)) * (rng.uniform(size=(count, 1)) < 0.5)
    if ends == "pinned":
        curvature = np.zeros((count, 3))
    axial = per_rope(1, 5) if stretchy else math.inf
    p = uniform(
        length=1.0, segments=nodes - 1, bend=bend, axial=axial, density=DENSITY, curvature=curvature
    )
    some = rng.uniform(size=(2, count)) > 0.25
    relaxation = (per_rope(-4, -1) * some[0])[:, None]
    air = np.broadcast_to((rng.uniform(0, 1, count) * some[1])[:, None], p.length.shape)
    viscous = 1e-3 * p.axial if stretchy else np.zeros(p.length.shape)
    damping = Damping(relaxation * p.bend, relaxation * p.twist, viscous, air)
    rod = build(p, DOWN, clamped)
    at = settle(rod, Conditions(held[:, 0], clamp[:, 0]))
    if ends == "hung":
        held[:, :, 1] = np.nan
    start = Start(at.x, at.q, np.zeros((count, nodes, 3)))
    few = np.flatnonzero(at.converged)
    made = moving(p, rod, damping, drag=np.zeros((count, len(DRAG_SPEEDS))))
    own = [name for name in made._fields if name not in ("rod", "bodies")]  # bodies are of all
    rope = made._replace(
        rod=Rod(*(t[few] for t in made.rod)), **{name: getattr(made, name)[few] for name in own}
    )
    return Motions(rope, Drive(time, held, clamp).clips(few), Start(*(s[few] for s in start)), rest)


class Paths(NamedTuple):
    """C motions of T frames: ends (C, T, 2, 3) [m], frames of the clamps (C, T, 2, 4), without
    jumps of sign, and the most that either end turns from one frame to the next (C,) [rad]."""

    ends: np.ndarray
    clamp: np.ndarray
    turn: np.ndarray


def paths(
    rng: np.random.Generator, count: int, time: np.ndarray, amplitude: np.ndarray, quickest: float
) -> Paths:
    """Draw smooth paths of the ends of ropes of 1 m at times (T,) or (C, T).

    The distance of the ends, its direction, where they are, and either clamp's rotation; up to
    `quickest` swings per unit of time.

    amplitude (C,): 1 turns the clamps by about a radian each way, leads the ends by half a metre.
    """
    swing = _Swings(rng, count, time, quickest)
    apart = rng.uniform(-3, 3, count)[:, None] + 3 * amplitude[:, None] * swing(1)[..., 0]
    apart = NEAREST + (FARTHEST - NEAREST) / (1 + np.exp(-apart))
    direction = rng.normal(size=(count, 1, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    wide = amplitude[:, None, None]
    direction = _turned(direction, wide * swing(3))
    first = 0.5 * wide * swing(3)
    ends = np.stack([first, first + apart[..., None] * direction], axis=2)
    at_rest = normalise(rng.normal(size=(count, 1, 2, 4)))
    turn = wide[..., None] * np.stack([swing(3), swing(3)], axis=2)
    clamp = multiply(from_rotation_vector(turn), at_rest)
    along = np.clip((clamp[:, 1:] * clamp[:, :-1]).sum(-1), -1, 1)
    return Paths(ends, clamp, 2 * np.arccos(along).max((1, 2)))


class _Swings:
    """Sines of random frequency and phase."""

    def __init__(self, rng, count: int, time: np.ndarray, quickest: float):
        self.rng, self.count, self.time, self.quickest = rng, count, time, quickest

    def __call__(self, many: int) -> np.ndarray:
        """Return values (C, T, many) between -1 and 1."""
        shape = (self.count, 1, many)
        rate = 2 * np.pi * self.quickest * self.rng.uniform(0.2, 1.0, shape)
        phase = self.rng.uniform(0, 2 * np.pi, shape)
        return np.sin(rate * np.atleast_2d(self.time)[..., None] + phase)


def _turned(vector: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) turned by rotation vectors [rad]: Rodrigues' formula."""
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    axis = turn / np.maximum(angle, 1e-300)
    across = np.cross(axis, vector)
    along = (axis * vector).sum(-1, keepdims=True) * axis
    return np.cos(angle) * vector + np.sin(angle) * across + (1 - np.cos(angle)) * along
