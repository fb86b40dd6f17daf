"""Concealed errors of measurement, and effects in no catalogue: place and size drawn at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.discovery.concealment import Concealed, with_field, with_point, with_rod
from benchmarks.discovery.setting import Setting, World, moved
from reference_simulators.rod_equations import Array, Field, Point, Rod, rotation


def scale_error(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw an error of scale, of the camera alone or of the measured ends as well. That of the
    camera alone is one of its depths: about the camera, that is the same."""
    sign, whole = float(rng.choice([-1, 1])), bool(rng.random() < 0.5)

    def change(world: World, size: float) -> World:
        scale = world.camera.scale + sign * size
        return replace(world, camera=replace(world.camera, scale=scale, ends_too=whole))

    if not whole:
        return Concealed(
            "depth_bias", "measurement", change, 0.02, 0.06, "gain", "1", None,
            lambda size: sign * size,
        )  # fmt: skip
    return Concealed(
        "scale_error", "measurement", change, 0.02, 0.06, "factor", "1", None,
        lambda size: 1 + sign * size,
    )  # fmt: skip


def end_offset(setting: Setting, rng: np.random.Generator) -> Concealed:
    end, way = int(rng.integers(0, 2)), rng.standard_normal(3)
    by = np.zeros((2, 3))
    by[end] = way / np.linalg.norm(way)

    def change(world: World, size: float) -> World:
        return replace(world, held=moved(world.held, size * by))

    at = end * setting.rod.length
    return Concealed("end_offset", "measurement", change, 0.01, 0.04, "offset", "m", (at, at))


def gravity_misalignment(setting: Setting, rng: np.random.Generator) -> Concealed:
    heading = rng.uniform(0, 2 * np.pi)
    axis = np.array([np.cos(heading), np.sin(heading), 0.0])

    def tilted(rod: Rod, size: float) -> tuple[float, ...]:
        return tuple(Rotation.from_rotvec(size * axis).apply(rod.gravity))

    change = with_rod(gravity=tilted)
    return Concealed(
        "gravity_misalignment", "measurement", change, np.radians(3), np.radians(12), "angle", "rad"
    )


def depth_bias(setting: Setting, rng: np.random.Generator) -> Concealed:
    sign = float(rng.choice([-1, 1]))

    def change(world: World, size: float) -> World:
        return replace(world, camera=replace(world.camera, depth=world.camera.depth + sign * size))

    return Concealed(
        "depth_bias", "measurement", change, 0.01, 0.04, "offset", "m", None,
        lambda size: sign * size,
    )  # fmt: skip


def lost_out_of_plane(setting: Setting, rng: np.random.Generator) -> Concealed:
    def change(world: World, size: float) -> World:
        return replace(world, camera=replace(world.camera, flat=size))

    return Concealed("lost_out_of_plane", "measurement", change, 0.5, 1.0, "share", "1")


def repulsion(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a soft repulsion of the whole rope from a point."""
    x: Array = setting.states[:, len(setting.problem.mesh) // 2, :3].mean(axis=0)
    way = rng.standard_normal(3)
    point = x + 0.12 * way / np.linalg.norm(way)
    change = with_field(lambda size: Field(point, np.zeros(3), 0.06, size, "bar", soft=True))
    return Concealed("repulsion", "unknown", change, 0.1, 20.0, "strength", "N/m", follows=True)


def follower_force(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a jet that is fixed to the rope and turns with it."""
    at = setting.rod.length * float(rng.uniform(0.3, 0.7))
    node = int(np.abs(setting.problem.mesh - at).argmin())
    turns = rotation(setting.states[:, node, 3:7]).mean(axis=0)
    way = turns.T @ np.array([0.0, rng.choice([-1.0, 1.0]), 0.0])  # sideways on the whole
    way = tuple(float(v) for v in way / np.linalg.norm(way))
    weight = setting.rod.density * setting.rod.length * 9.81
    change = with_point(lambda size: Point(at, follower=tuple(size * v for v in way)))  # pyright: ignore[reportArgumentType]
    return Concealed(
        "follower_force", "unknown", change, 0.02 * weight, weight, "force", "N", (at, at),
        follows=True,
    )  # fmt: skip


def nonlinear_bending(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a softening in bending: the stiffness halves at a moment."""
    moment = float(np.abs(setting.states[..., 10:]).max())
    change = with_rod(softening=lambda _, size: size)
    return Concealed(
        "nonlinear_bending", "unknown", change, 0.3 / moment**2, 300 / moment**2, "softening",
        "1/(N m)^2", follows=True,
    )  # fmt: skip


MEASUREMENT = {
    "scale_error": scale_error, "end_offset": end_offset,
    "gravity_misalignment": gravity_misalignment, "depth_bias": depth_bias,
    "lost_out_of_plane": lost_out_of_plane,
}  # fmt: skip
UNKNOWN = {
    "repulsion": repulsion, "follower_force": follower_force,
    "nonlinear_bending": nonlinear_bending,
}  # fmt: skip
