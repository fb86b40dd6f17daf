"""Ropes filmed in motion: MuJoCo's rope is led once along its path at a steady pace.

What then shows is inertia, the drag of a medium, and a gripper whose clock is not the camera's.
One of them is asked for; inertia is there always, and a cause wherever it is visible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.made import Made, Sized
from benchmarks.discovery.score import VISIBLE
from benchmarks.discovery.setting import PRIORS, Setting, World, draw, miscalibrated
from benchmarks.discovery.strength import Meter, meter, shapes
from reference_simulators import mujoco_rope
from reference_simulators.kirchhoff_rod import Ends
from reference_simulators.rod_equations import Array, rotation

POSES = 40  # of a turn, at which the rope is known at rest as well
EACH = 3  # frames from pose to pose
FRAMES = EACH * POSES
STEADY = 0.5  # of a turn: in which the rope gets up to its pace, before it is filmed
FIRST, PACES = 6.0, (2.5, 11.0)  # s, a turn
SLOW = (8.0, 11.0)  # s, a turn where inertia is not the point
AIR = 0.05  # 1/s
DRAGS = (2 * AIR, 30.0)  # 1/s
LAGS = (3 * PRIORS["clock"], 0.25)  # s


@dataclass(frozen=True)
class Film:
    """period [s] of a turn; drag [1/s] of the medium, force per mass and speed; lag [s] by which
    the ends are recorded late."""

    period: float
    drag: float = AIR
    lag: float = 0.0


def make(
    kind: str, wanted: float, seed: int, clamped: bool, calibration: bool
) -> tuple[Made, Made]:
    """Make a rope in motion in which the kind has about the wanted score, and the same at rest."""
    rng = np.random.default_rng(seed)
    setting = draw(clamped, rng, count=POSES)
    scale = meter(setting)
    choose = {"inertia": _paced, "damping": _thick, "time_lag": _late}[kind]
    film = choose(setting, scale, wanted, rng)
    visible, (s, nodes) = scores(setting, scale, film)
    causes = [
        Sized(_cause(name, size), size, score, list(range(FRAMES)))
        for name, size, score in visible
        if score >= VISIBLE
    ]
    world = setting.world
    if calibration:
        world = miscalibrated(world, rng)
        s, nodes = filmed(world, setting.diameter, film)
    causes.sort(key=lambda one: one.effect.name != kind)
    told = replace(setting, held=seen(setting.held, film.lag / film.period))
    true = replace(world, held=seen(world.held))
    interval = film.period / FRAMES
    moving = Made(told, true, causes, s, nodes, mujoco_rope.tangents(s, nodes), "mujoco", interval)
    goal, states = shapes(setting, world)
    ways = rotation(states[..., 3:7])[..., 2]
    return moving, Made(setting, world, [], goal.mesh, states[..., :3], ways, "elastica")


def filmed(world: World, diameter: float, film: Film) -> tuple[Array, Array]:
    """Return arc lengths (n,) [m] and centrelines (T, n, 3) [m] of a turn in steady motion."""
    pose = path(world.held, film)
    rope = mujoco_rope.Rope(world.rod, world.held, diameter)
    rope.rest(pose(0.0))
    return rope.arc_length, rope.filmed(pose, times(film), film.drag)


def path(held: Ends, film: Film) -> Callable[[float], tuple[Array, Array]]:
    """Place (3,) [m] and direction (3,) of end 0 at a time [s] from rest on."""
    place, way = _round(held.positions[:, 0]), _round(rotation(held.orientations)[:, 0, :, 2])
    lead = STEADY * film.period

    def pose(time: float) -> tuple[Array, Array]:
        u = time / lead
        turns = STEADY * (u**3 - 0.5 * u**4 - 0.5 if u < 1 else u - 1)
        direction = way(turns % 1)
        return place(turns % 1), direction / np.linalg.norm(direction)

    return pose


def times(film: Film) -> Array:
    """Return the times (FRAMES,) [s] of the frames, from rest on."""
    return film.period * (STEADY + np.arange(FRAMES) / FRAMES)


def seen(held: Ends, late: float = 0.0) -> Ends:
    """Return the ends in every frame of a film, by a clock that is late by a share of a turn."""
    at = (np.arange(FRAMES) / FRAMES - late) % 1
    turns = held.orientations.copy()
    for t in range(1, POSES):  # of the two quaternions of a rotation, the nearer
        turns[t] *= np.sign((turns[t] * turns[t - 1]).sum(-1, keepdims=True))
    orientations = _round(turns)(at)
    orientations /= np.linalg.norm(orientations, axis=-1, keepdims=True)
    return replace(held, positions=_round(held.positions)(at), orientations=orientations)


def scores(
    setting: Setting, scale: Meter, film: Film
) -> tuple[list[tuple[str, float, float]], tuple[Array, Array]]:
    """Name, size in SI and score of everything that a film shows, and the film itself.

    Clocks are a little off in every film: what that explains is no sign of a lag, nor of drag.
    """
    at, scale = setting.problem.mesh[scale.index], with_clock(scale, film)

    def points(s: Array, nodes: Array) -> Array:
        return CubicSpline(s, nodes[::EACH], axis=1)(at)

    picture = filmed(setting.world, setting.diameter, replace(film, drag=AIR))
    free = points(*picture)
    out = [("inertia", 1.0, scale.score(free - scale.points))]
    if film.drag > AIR:
        picture = filmed(setting.world, setting.diameter, film)
        dragged = scale.score(points(*picture) - free)
        out.append(("damping", film.drag * setting.rod.density, dragged))
    if film.lag:
        now = np.arange(POSES) / POSES
        behind = _round(scale.points)((now - film.lag / film.period) % 1) - scale.points
        out.append(("time_lag", film.lag, scale.score(behind)))
    return out, picture


def with_clock(scale: Meter, film: Film) -> Meter:
    """Return the meter of a film, in which the clock of the ends may be off as well."""
    velocity = _round(scale.points)(np.arange(POSES) / POSES, 1) / film.period
    off = scale.whitened(PRIORS["clock"] * velocity)
    return replace(scale, nuisances=np.column_stack([scale.nuisances, off]))


def _paced(setting: Setting, scale: Meter, wanted: float, rng: np.random.Generator) -> Film:
    """Choose the pace at which inertia has the wanted score: it grows with its square."""
    score = scores(setting, scale, Film(FIRST))[0][0][2]
    return Film(float(np.clip(FIRST * np.sqrt(score / wanted), *PACES)))


def _thick(setting: Setting, scale: Meter, wanted: float, rng: np.random.Generator) -> Film:
    """Choose the medium whose drag has the wanted score."""
    film = Film(float(rng.uniform(*SLOW)), drag=1.0)
    score = scores(setting, scale, film)[0][1][2]
    return replace(film, drag=float(np.clip(film.drag * wanted / score, *DRAGS)))


def _late(setting: Setting, scale: Meter, wanted: float, rng: np.random.Generator) -> Film:
    """Choose the lag of the clock that has the wanted score."""
    film = Film(float(rng.uniform(*SLOW)), lag=0.03 * float(rng.choice([-1.0, 1.0])))
    score = scores(setting, scale, film)[0][1][2]
    lag = float(np.clip(abs(film.lag) * wanted / score, *LAGS))
    return replace(film, lag=lag * np.sign(film.lag))


def _cause(name: str, size: float) -> Concealed:
    kind = "measurement" if name == "time_lag" else "physics"
    told = {"inertia": ("share", "1"), "damping": ("air", "N s/m^2"), "time_lag": ("lag", "s")}
    return Concealed(name, kind, lambda world, size: world, size, size, *told[name])


def _round(values: Array) -> CubicSpline:
    """Interpolate values (T, ...) at equal steps of a closed path, by turns from 0 to 1."""
    closed = np.concatenate([values, values[:1]])
    return CubicSpline(np.linspace(0, 1, len(closed)), closed, bc_type="periodic")
