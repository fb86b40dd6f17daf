"""A rope in motion as it is recorded: drawn from a seed, filmed by MuJoCo or PyElastica, written to
files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.discovery import elastica_motion
from benchmarks.discovery.motion_causes import CAUSES, FIRST_POSES, GRIPPED, Concealed, Told
from benchmarks.discovery.setting import Setting, World, draw
from reference_simulators import mujoco_rope
from reference_simulators.kirchhoff_rod import CLAMPED
from reference_simulators.rod_equations import Array, rotation

CLIPS, FRAMES, STEP = 3, 150, 0.01  # s
PAUSE = 10.0  # s between clips
MARKERS = 11
NOISE = (5e-5, 2e-4)  # m per coordinate
DRAG = (0.1, 0.8)  # 1/s, of the medium
LAW_DRAG, LAW_SPEED = 4.0, 0.5  # times that, at a speed [m/s], where it is not linear
RISE = 0.3  # s, until the sway is at its height
FARTHEST = 0.985  # of the rope's length: no farther are the ends ever apart
TURNED = 0.2  # rad, of a gripper about each axis
TIMES: Array = STEP * np.arange(FRAMES, dtype=np.float64)  # s, of a clip

Pose = Callable[[float], tuple[Array, Array]]  # place (3,) [m] and turn (4,) of end 0 at a time


@dataclass(frozen=True)
class Scene:
    """What a seed draws.

    cause: the name of what is concealed; poses: of end 0, and last: turn (4,) of end 1, of each
    clip (pinned ends' turns say nothing); rate [1/s]: of the medium's drag; noise [m], and what it
    adds to the markers (CLIPS * FRAMES, MARKERS, 3) [m].
    """

    cause: str
    setting: Setting
    world: World
    told: Told
    concealed: Concealed | None
    rate: float
    poses: list[Pose]
    last: list[Array]
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
    setting = draw(cases == GRIPPED, rng, count=12)
    world, told, concealed = cause(setting, rng)
    rate, noise = float(rng.uniform(*DRAG)), float(rng.uniform(*NOISE))
    poses = [sway(world, FIRST_POSES[clip], rng) for clip in range(CLIPS)]
    last = [world.held.orientations[FIRST_POSES[clip], 1] for clip in range(CLIPS)]
    jitter = noise * rng.standard_normal((CLIPS * FRAMES, MARKERS, 3))
    if concealed is not None and concealed.above_ends:
        height = float(_ends(world, told, poses)[..., 2].mean())
        concealed = replace(concealed, size=concealed.size - height)
    return Scene(cause.__name__, setting, world, told, concealed, rate, poses, last, noise, jitter)


def filmed(
    scene: Scene, drag: mujoco_rope.Drag, elastica: Path | None, markers: int = MARKERS
) -> Array:
    """Return the places (CLIPS * FRAMES, markers, 3) [m] of a scene's markers, without noise.

    elastica: a Python that has PyElastica, to film it with, instead of by MuJoCo.
    """
    world, at = scene.world, np.linspace(0, scene.world.rod.length, markers)
    if elastica:
        assert not callable(drag)
        fine = np.arange(0, TIMES[-1] + 0.1, elastica_motion.SAMPLE)
        ways = [[pose(t) for t in fine] for pose in scene.poses]
        places, turns = (np.array([[one[k] for one in way] for way in ways]) for k in range(2))
        arc, x = elastica_motion.filmed(
            elastica, world, places, turns, np.array(scene.last), TIMES, drag
        )
        return CubicSpline(arc, x, axis=2)(at).reshape(-1, markers, 3)
    out = []
    for pose in scene.poses:
        facing = _directed(pose)
        rope = mujoco_rope.Rope(world.rod, world.held, scene.setting.diameter)
        rope.rest(facing(0.0))
        seen = rope.filmed(facing, TIMES, drag)
        out.append(CubicSpline(rope.arc_length, seen, axis=1)(at))
    return np.concatenate(out)


def _directed(pose: Pose) -> Pose:
    """Return a pose with the rope's direction (3,) there instead of the turn."""
    return lambda time: (pose(time)[0], rotation(pose(time)[1])[:, 2])


def record(folder: Path, name: str, scene: Scene, elastica: Path | None = None) -> None:
    """Film a scene and write its recording."""
    write(folder, name, scene, filmed(scene, scene.drag, elastica) + scene.jitter)


def write(folder: Path, name: str, scene: Scene, markers: Array) -> None:
    """Write the recording of a scene in which markers (CLIPS * FRAMES, M, 3) [m] were seen."""
    path = _ends(scene.world, scene.told, scene.poses)
    turns = _turns(scene) if scene.world.held.kinds[0] == CLAMPED else None
    _write(folder, name, scene.setting, scene.told, path, turns, markers)


def powered(rate: float, power: float) -> Callable[[Array], Array]:
    """Return a drag per mass and speed that grows with the speed, LAW_DRAG times `rate` at
    LAW_SPEED."""
    return lambda speeds: LAW_DRAG * rate * np.maximum(speeds / LAW_SPEED, 0.01) ** (power - 1)


def sway(world: World, frame: int, rng: np.random.Generator) -> Pose:
    """Return end 0 shaken, and turned if it is clamped, about a pose."""
    first, other = world.held.positions[frame, :2]
    turn = world.held.orientations[frame, 0]
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
    if world.held.kinds[0] != CLAMPED:
        return lambda time: (first + size * shaken(time), turn)
    most: Array = TURNED * rng.uniform(0.5, 1.0, 3)
    spin, offset = rng.uniform(4, 9, 3), rng.uniform(0, 2 * np.pi, 3)

    def turned(time: float) -> Array:
        grown = min(max(time, 0.0) / RISE, 1.0) ** 2
        return turned_by(grown * most * (np.sin(spin * time + offset) - np.sin(offset)), turn)

    return lambda time: (first + size * shaken(time), turned(time))


def turned_by(rotation_vector: Array, turn: Array) -> Array:
    """Return a turn (4,) after a rotation (3,) [rad] about axes in space."""
    by = Rotation.from_rotvec(rotation_vector) * Rotation.from_quat(np.roll(turn, -1))
    q = np.roll(by.as_quat(), 1)
    return q * np.sign(q @ turn)


def _apart(ends: Array, other: Array) -> float:
    """Return the largest distance [m] of ends (T, 3) from the other end (3,)."""
    return float(np.linalg.norm(ends - other, axis=-1).max())


def _ends(world: World, told: Told, poses: list[Pose]) -> Array:
    """Return the places (CLIPS * FRAMES, 2, 3) [m] of the ends, as recorded."""
    late = TIMES - told.lag
    other = world.held.positions[0, 1]
    return np.stack([[pose(t)[0], other] for pose in poses for t in late])


def _turns(scene: Scene) -> Array:
    """Return the turns (CLIPS * FRAMES, 2, 4) of both clamps, as recorded."""
    told = [told_clamp(scene, clip) for clip in range(CLIPS)]
    return np.array([[pose(t)[1], last] for pose, last in told for t in TIMES - scene.told.lag])


def told_clamp(scene: Scene, clip: int) -> tuple[Pose, Array]:
    """Return end 0's pose and end 1's turn (4,) in a clip, with the clamp as it is told."""
    pose, last, tilt = scene.poses[clip], scene.last[clip], scene.told.clamp
    if not any(tilt):
        return pose, last
    own = Rotation.from_rotvec(tilt)

    def tilted(time: float) -> tuple[Array, Array]:
        place, turn = pose(time)
        held = Rotation.from_quat(np.roll(turn, -1)) * own
        return place, np.roll(held.as_quat(), 1)

    return tilted, last


def _write(
    folder: Path, name: str, setting: Setting, told: Told, ends: Array, turns: Array | None,
    markers: Array,
) -> None:  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    time = np.concatenate([TIMES + k * (PAUSE + STEP * FRAMES) for k in range(CLIPS)])
    rod, length = setting.rod, told.length * setting.rod.length
    arc = np.linspace(0, length, markers.shape[1])
    np.savez(folder / "markers.npz", positions=markers, time=time, arc_length=arc)
    rows = ["frame,time,end,x,y,z" + ",qw,qx,qy,qz" * (turns is not None)]
    for f, now in enumerate(time):
        for end in range(2):
            pose = [*ends[f, end], *(() if turns is None else turns[f, end])]
            rows.append(f"{f},{now:.9g},{end}," + ",".join(f"{v:.9g}" for v in pose))
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


def as_told(scene: Scene) -> Scene:
    """Return a scene without what is concealed: as the recording tells it."""
    setting, told = scene.setting, scene.told
    rod, length = setting.rod, told.length * setting.rod.length
    density = rod.density * rod.length / length
    plain: Any = replace(rod, length=length, density=density, gravity=told_gravity(told))
    clamps = [told_clamp(scene, clip) for clip in range(CLIPS)]
    poses: list[Pose] = [lambda time, one=pose: one(time - told.lag) for pose, _ in clamps]
    world = replace(setting.world, rod=plain)
    return replace(scene, world=world, poses=poses)
