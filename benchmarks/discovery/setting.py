"""A rope, a motion and a camera, drawn at random; and the true world that an effect changes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.discovery.clouds import CameraErrors, Sensor
from reference_simulators.history_dependent_rod import Law
from reference_simulators.kirchhoff_rod import CLAMPED, PINNED, Ends, RodProblem, facing, hang
from reference_simulators.rod_equations import Array, Rod

FIXED_END = np.array([0.40, 0.0, 0.60])  # m
GJ_TO_EI = 1 / 1.3  # round section, Poisson's ratio 0.3

# One-sigma errors of a careful set-up.
PRIORS = {
    "camera_rotation": np.radians(0.2),
    "camera_translation": 0.002,
    "scale": 0.003,
    "depth_gain": 0.005,
    "gravity": np.radians(0.2),
    "end_position": 0.0015,
    "end_orientation": np.radians(1.0),
    "clock": 0.003,  # s, of the ends against that of the camera
}
INTERVAL = 1.0  # s, from frame to frame
END_NOISE = 0.00015  # m, sd per axis and frame of a measured end
TILT_NOISE = np.radians(0.1)  # rad, likewise


@dataclass(frozen=True)
class World:
    """What is true: the rod, how its ends are held, how the camera sees it."""

    rod: Rod
    held: Ends
    camera: CameraErrors = field(default_factory=CameraErrors)
    law: Law | None = None  # by which the rope remembers


@dataclass(frozen=True)
class Setting:
    """A recording before anything is wrong with it."""

    rod: Rod
    held: Ends
    sensor: Sensor
    diameter: float  # m
    problem: RodProblem
    states: Array  # (T, N + 1, 13) at problem.mesh

    @property
    def world(self) -> World:
        return World(self.rod, self.held)


def motion(
    length: float, frames: int, clamped: bool, rng: np.random.Generator, back: bool = False
) -> Ends:
    """Draw the motion: end 0 is brought nearer and taut, lifted, swept and turned; end 1 stays.

    Smooth, and no pose comes twice; with `back`, half of the way and back again.
    """
    phase = np.linspace(0, 2 * np.pi, frames, endpoint=False)
    if back:
        phase = 0.5 * np.pi * (1 - np.cos(phase * frames / (frames - 1)))
    shift = rng.uniform(0, 2 * np.pi, 6)
    near, far = rng.uniform(0.35, 0.45), rng.uniform(0.85, 0.94)
    wave = np.cos(phase + shift[0]) + 0.15 * np.sin(2 * phase + shift[1])
    wave = (wave - wave.min()) / np.ptp(wave)
    distance = length * (near + (far - near) * wave)
    elevation = rng.uniform(0.2, 0.35) * np.sin(2 * phase + shift[2])
    azimuth = rng.uniform(0.35, 0.65) * np.sin(phase + shift[3])
    flat = np.cos(elevation)
    away = np.stack([-flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)], axis=1)
    positions = np.stack(
        [FIXED_END + distance[:, None] * away, np.tile(FIXED_END, (frames, 1))], axis=1
    )
    orientations = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 2, 1))
    if not clamped:
        return Ends(positions, orientations, (PINNED, PINNED))
    pitch = rng.uniform(-0.6, -0.3) + rng.uniform(0.25, 0.45) * np.sin(phase + shift[4])
    yaw = -azimuth + rng.uniform(0.2, 0.35) * np.sin(phase + shift[5])
    first = np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1
    )
    rise, side = rng.uniform(0.1, 0.5), rng.uniform(-0.2, 0.2)
    last = np.array([np.cos(rise) * np.cos(side), np.cos(rise) * np.sin(side), np.sin(rise)])
    for frame in range(frames):
        for end, tangent in enumerate((first[frame], last)):
            orientations[frame, end] = np.roll(facing(tangent).as_quat(), 1)
    return Ends(positions, orientations, (CLAMPED, CLAMPED))


def draw(
    clamped: bool,
    rng: np.random.Generator,
    breaks: tuple[float, ...] = (),
    back: bool = False,
    count: int | None = None,
) -> Setting:
    """Draw a random hanging rope.

    `breaks` are fractions of its length; for `back` see `motion`; `count` of frames, else as many
    as a person records poses.
    """
    length = float(rng.uniform(0.8, 1.2))
    density = float(rng.uniform(0.03, 0.09))
    bending = float(10 ** rng.uniform(-4, np.log10(2e-3))) * density * 9.81 * length**3
    poses = int(rng.integers(24, 37))
    sensor = Sensor(
        viewpoint=(
            float(rng.uniform(-0.3, 0.3)),
            float(rng.uniform(-1.6, -1.3)),
            float(rng.uniform(0.3, 0.8)),
        ),
        noise=float(rng.uniform(0.0008, 0.0015)),
        points=int(rng.integers(250, 450)),
        occluded=float(rng.uniform(0.05, 0.15)),
    )
    rod = Rod(length, density, bending, GJ_TO_EI * bending)
    held = motion(length, count or poses, clamped, rng, back)
    places = [part * length for part in breaks]
    rolling, states = hang(rod, held, breaks=places)
    held = grasped(held, states)
    problem = replace(rolling, rod=rod, held=held, gauge=not clamped)
    return Setting(rod, held, sensor, float(rng.uniform(0.004, 0.010)), problem, states)


def grasped(held: Ends, states: Array) -> Ends:
    """Return ends with the frames of a rope without twist: gripped as it is."""
    turns = states[:, [0, -1], 3:7]
    return replace(held, orientations=turns / np.linalg.norm(turns, axis=2, keepdims=True))


def miscalibrated(world: World, rng: np.random.Generator) -> World:
    """Return the world with errors of the set-up, one draw of the priors for all frames."""

    def normal(name: str, size: int) -> Array:
        return PRIORS[name] * rng.standard_normal(size)

    camera = replace(
        world.camera,
        rotation=tuple(normal("camera_rotation", 3)),
        translation=tuple(normal("camera_translation", 3)),
        scale=world.camera.scale + float(normal("scale", 1)[0]),
        gain=world.camera.gain + float(normal("depth_gain", 1)[0]),
    )
    tilt = Rotation.from_rotvec([*normal("gravity", 2), 0.0])
    rod = replace(world.rod, gravity=tuple(tilt.apply(world.rod.gravity)))
    held = moved(world.held, normal("end_position", 6).reshape(2, 3))
    held = turned(held, normal("end_orientation", 6).reshape(2, 3))
    return replace(world, rod=rod, held=held, camera=camera)


def moved(held: Ends, by: Array) -> Ends:
    """Return the ends moved by (2, 3) [m] in all frames."""
    return replace(held, positions=held.positions + by)


def turned(held: Ends, by: Array) -> Ends:
    """Return clamps turned by rotation vectors (2, 3) [rad] in their own axes."""
    out = held.orientations.copy()
    for end in range(2):
        for frame in range(len(out)):
            now = Rotation.from_quat(np.roll(out[frame, end], -1)) * Rotation.from_rotvec(by[end])
            out[frame, end] = np.roll(now.as_quat(), 1)
    # Keep the sign, so that neighbouring quaternions stay neighbours.
    out *= np.sign((out * held.orientations).sum(-1, keepdims=True))
    return replace(held, orientations=out)
