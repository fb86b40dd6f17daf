"""A rope in motion as it is recorded: drawn from a seed, filmed by MuJoCo, written to files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.motion_causes import CAUSES, FIRST_POSES, Concealed, Told
from benchmarks.discovery.setting import Setting, World, draw
from reference_simulators import mujoco_rope
from reference_simulators.rod_equations import Array

CLIPS, FRAMES, STEP = 3, 150, 0.01  # s
PAUSE = 10.0  # s between clips
MARKERS = 11
NOISE = (5e-5, 2e-4)  # m per coordinate
DRAG = (0.1, 0.8)  # 1/s, of the medium
LAW_DRAG, LAW_SPEED = 4.0, 0.5  # times that, at a speed [m/s], where it is not linear
RISE = 0.3  # s, until the sway is at its height
FARTHEST = 0.985  # of the rope's length: no farther are the ends ever apart
TIMES: Array = STEP * np.arange(FRAMES, dtype=np.float64)  # s, of a clip

Pose = Callable[[float], tuple[Array, Array]]


@dataclass(frozen=True)
class Scene:
    """What a seed draws.

    cause: the name of what is concealed; poses: place (3,) [m] and direction (3,) of end 0 at a
    time, of each clip; rate [1/s]: of the medium's drag; noise [m], and what it adds to the markers
    (CLIPS * FRAMES, MARKERS, 3) [m].
    """

    cause: str
    setting: Setting
    world: World
    told: Told
    concealed: Concealed | None
    rate: float
    poses: list[Pose]
    noise: float
    jitter: Array

    @property
    def drag(self) -> mujoco_rope.Drag:
        """Return the medium's drag."""
        power = self.concealed.drag if self.concealed else 1.0
        return self.rate if power == 1 else powered(self.rate, power)


def staged(seed: int, cases: str) -> Scene:
    """Draw a scene."""
    rng = np.random.default_rng([seed, 77])
    cause = CAUSES[cases][seed % len(CAUSES[cases])]
    setting = draw(False, rng, count=12)
    world, told, concealed = cause(setting, rng)
    rate, noise = float(rng.uniform(*DRAG)), float(rng.uniform(*NOISE))
    poses = [sway(world, FIRST_POSES[clip], rng) for clip in range(CLIPS)]
    jitter = noise * rng.standard_normal((CLIPS * FRAMES, MARKERS, 3))
    if concealed is not None and concealed.above_ends:
        height = float(_ends(world, told, poses)[..., 2].mean())
        concealed = replace(concealed, size=concealed.size - height)
    return Scene(cause.__name__, setting, world, told, concealed, rate, poses, noise, jitter)


def filmed(world: World, diameter: float, poses: list[Pose], drag: mujoco_rope.Drag) -> Array:
    """Return the places (CLIPS * FRAMES, MARKERS, 3) [m] of the markers, without noise."""
    out = []
    for pose in poses:
        rope = mujoco_rope.Rope(world.rod, world.held, diameter)
        rope.rest(pose(0.0))
        seen = rope.filmed(pose, TIMES, drag)
        at = np.linspace(0, world.rod.length, MARKERS)
        out.append(CubicSpline(rope.arc_length, seen, axis=1)(at))
    return np.concatenate(out)


def record(folder: Path, name: str, scene: Scene) -> None:
    """Film a scene and write its recording."""
    markers = filmed(scene.world, scene.setting.diameter, scene.poses, scene.drag) + scene.jitter
    path = _ends(scene.world, scene.told, scene.poses)
    _write(folder, name, scene.setting, scene.told, path, markers)


def powered(rate: float, power: float) -> Callable[[Array], Array]:
    """Return a drag per mass and speed that grows with the speed, LAW_DRAG times `rate` at
    LAW_SPEED."""
    return lambda speeds: LAW_DRAG * rate * np.maximum(speeds / LAW_SPEED, 0.01) ** (power - 1)


def sway(world: World, frame: int, rng: np.random.Generator) -> Pose:
    """Return place (3,) [m] and direction (3,) of end 0 at a time [s]: shaken about a pose."""
    first, other = world.held.positions[frame, :2]
    way = np.array([1.0, 0.0, 0.0])  # of a pinned end: says nothing
    first = first + 0.1 * (other - first)  # room to be shaken in
    reach: Array = 0.07 * world.rod.length * rng.uniform(0.7, 1.2, 3)
    rate, phase = rng.uniform(4, 9, 3), rng.uniform(0, 2 * np.pi, 3)

    def shaken(time: float) -> Array:
        grown = min(max(time, 0.0) / RISE, 1.0) ** 2
        return grown * reach * (np.sin(rate * time + phase) - np.sin(phase))

    times = np.arange(-0.1, STEP * FRAMES + 0.1, STEP / 2)
    size = 1.0
    while _apart(first + size * np.stack([shaken(t) for t in times]), other) > (
        FARTHEST * world.rod.length
    ):
        size *= 0.9
    return lambda time: (first + size * shaken(time), way)


def _apart(ends: Array, other: Array) -> float:
    """Return the largest distance [m] of ends (T, 3) from the other end (3,)."""
    return float(np.linalg.norm(ends - other, axis=-1).max())


def _ends(world: World, told: Told, poses: list[Pose]) -> Array:
    """Return the places (CLIPS * FRAMES, 2, 3) [m] of the ends, as recorded."""
    late = TIMES - told.lag
    other = world.held.positions[0, 1]
    return np.stack([[pose(t)[0], other] for pose in poses for t in late])


def _write(
    folder: Path, name: str, setting: Setting, told: Told, ends: Array, markers: Array
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    time = np.concatenate([TIMES + k * (PAUSE + STEP * FRAMES) for k in range(CLIPS)])
    rod, length = setting.rod, told.length * setting.rod.length
    arc = np.linspace(0, length, MARKERS)
    np.savez(folder / "markers.npz", positions=markers, time=time, arc_length=arc)
    rows = ["frame,time,end,x,y,z"]
    for f, now in enumerate(time):
        for end in range(2):
            rows.append(f"{f},{now:.9g},{end}," + ",".join(f"{v:.9g}" for v in ends[f, end]))
    (folder / "ends.csv").write_text("\n".join(rows) + "\n")
    gravity = [round(v, 9) for v in told_gravity(told)]
    mass = rod.density * rod.length
    (folder / "recording.toml").write_text(
        f'format = "ropefit-recording/1"\nname = "{name}"\n'
        f"gravity = {gravity}\n"
        f"[rope]\nlength = {length:.9g}\nmass = {mass:.9g}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )


def told_gravity(told: Told) -> tuple[float, float, float]:
    """Return gravity [m/s²] as a recording tells it."""
    size, tilt = told.gravity * 9.81, told.gravity_tilt
    return float(size * np.sin(tilt)), 0.0, float(-size * np.cos(tilt))


def as_told(scene: Scene) -> tuple[World, list[Pose]]:
    """Return the world and the poses without what is concealed: as the recording tells them."""
    setting, told = scene.setting, scene.told
    rod, length = setting.rod, told.length * setting.rod.length
    density = rod.density * rod.length / length
    plain: Any = replace(rod, length=length, density=density, gravity=told_gravity(told))
    poses: list[Pose] = [lambda time, one=pose: one(time - told.lag) for pose in scene.poses]
    return replace(setting.world, rod=plain), poses
