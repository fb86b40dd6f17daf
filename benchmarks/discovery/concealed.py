"""Concealed physics: one function for each effect, its place and size drawn at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.discovery.concealment import (
    Concealed,
    interval,
    with_field,
    with_point,
    with_rod,
    with_section,
)
from benchmarks.discovery.setting import INTERVAL, Setting, World
from reference_simulators.history_dependent_rod import Law
from reference_simulators.rod_equations import Field, Point, Section

CONTACT_HARDNESS = 5e3  # N/m²: a rope of 0.5 N/m sinks in by 0.1 mm


def point_mass(setting: Setting, rng: np.random.Generator) -> Concealed:
    at = setting.rod.length * float(rng.uniform(0.2, 0.8))
    weight = setting.rod.density * setting.rod.length
    change = with_point(lambda size: Point(at, mass=size))
    return Concealed(
        "point_mass", "physics", change, 0.02 * weight, 0.8 * weight, "mass", "kg", (at, at)
    )


def mass_section(setting: Setting, rng: np.random.Generator) -> Concealed:
    rod = setting.rod
    a, b = interval(rod, rng, 0.12, 0.3)
    own = rod.density * (b - a)
    change = with_section(lambda size: Section(a, b, density=1 + size / own))
    return Concealed("mass_section", "physics", change, 0.2 * own, 4 * own, "mass", "kg", (a, b))


def intrinsic_curvature(setting: Setting, rng: np.random.Generator) -> Concealed:
    a, b = interval(setting.rod, rng, 0.3, 0.7)
    turn = rng.uniform(0, 2 * np.pi)
    c, s = float(np.cos(turn)), float(np.sin(turn))
    change = with_section(lambda size: Section(a, b, curvature=(size * c, size * s)))
    return Concealed(
        "intrinsic_curvature", "physics", change, 0.3, 4.0, "curvature", "1/m", (a, b), follows=True
    )


def kink(setting: Setting, rng: np.random.Generator) -> Concealed:
    at = setting.rod.length * float(rng.uniform(0.2, 0.8))
    turn = rng.uniform(0, 2 * np.pi)
    c, s = float(np.cos(turn)), float(np.sin(turn))
    change = with_point(lambda size: Point(at, turn=(size * c, size * s)))
    return Concealed("kink", "physics", change, 0.1, 1.0, "angle", "rad", (at, at), follows=True)


def stiff_section(setting: Setting, rng: np.random.Generator) -> Concealed:
    a, b = interval(setting.rod, rng, 0.1, 0.25)
    change = with_section(lambda size: Section(a, b, bending=1 + size))
    return Concealed(
        "stiff_section", "physics", change, 0.5, 15.0, "factor", "1", (a, b), lambda size: 1 + size
    )


def soft_section(setting: Setting, rng: np.random.Generator) -> Concealed:
    a, b = interval(setting.rod, rng, 0.1, 0.25)
    change = with_section(lambda size: Section(a, b, bending=1 / (1 + size)))
    return Concealed(
        "soft_section", "physics", change, 0.5, 9.0, "factor", "1", (a, b),
        lambda size: 1 / (1 + size),
    )  # fmt: skip


def axial_extensibility(setting: Setting, rng: np.random.Generator) -> Concealed:
    change = with_rod(compliance=lambda _, size: size)
    return Concealed("axial_extensibility", "physics", change, 0.02, 0.3, "compliance", "1/N")


def distributed_load(setting: Setting, rng: np.random.Generator) -> Concealed:
    heading, rise = rng.uniform(0, 2 * np.pi), rng.uniform(-0.2, 0.2)
    way = np.array([np.cos(heading), np.sin(heading), rise])
    way /= np.linalg.norm(way)
    weight = setting.rod.density * 9.81
    change = with_rod(load=lambda rod, size: tuple(np.asarray(rod.load) + size * way))
    return Concealed(
        "distributed_load", "physics", change, 0.03 * weight, 0.5 * weight, "force_per_length",
        "N/m",
    )  # fmt: skip


def clamped_end(setting: Setting, rng: np.random.Generator) -> Concealed:
    end = int(rng.integers(0, 2))
    rise, side = rng.uniform(-0.3, 0.6), rng.uniform(-0.4, 0.4)
    if end == 0:
        rise, side = -rise, rng.uniform(-0.3, 0.3)
    way = np.array([np.cos(rise) * np.cos(side), np.cos(rise) * np.sin(side), np.sin(rise)])

    def change(world: World, size: float) -> World:
        springs = list(world.rod.end_springs)
        springs[end] = (size, way)
        return replace(world, rod=replace(world.rod, end_springs=tuple(springs)))

    at = end * setting.rod.length
    unit = setting.rod.bending / setting.rod.length
    return Concealed(
        "clamped_end", "physics", change, unit, 1000 * unit, "stiffness", "N m/rad", (at, at)
    )


def end_twist(setting: Setting, rng: np.random.Generator) -> Concealed:
    sign = float(rng.choice([-1, 1]))

    def change(world: World, size: float) -> World:
        held = world.held
        half = np.array([np.cos(size / 2), 0.0, 0.0, sign * np.sin(size / 2)])
        out = held.orientations.copy()
        a, b, c, d = np.moveaxis(out[:, 0], -1, 0)
        w, z = half[0], half[3]
        out[:, 0] = np.stack([a * w - d * z, b * w + c * z, c * w - b * z, d * w + a * z], axis=1)
        return replace(world, held=replace(held, orientations=out))

    return Concealed(
        "end_twist", "physics", change, 0.3, 3.0, "angle", "rad",
        (0.0, setting.rod.length), follows=True,
    )  # fmt: skip


def tether(setting: Setting, rng: np.random.Generator) -> Concealed:
    at = setting.rod.length * float(rng.uniform(0.25, 0.75))
    node = int(np.abs(setting.problem.mesh - at).argmin())
    middle = setting.states[:, node, :3].mean(axis=0)
    heading, rise = rng.uniform(0, 2 * np.pi), rng.uniform(-0.6, 0.6)
    way = np.array([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])
    x, y, z = (float(v) for v in middle + rng.uniform(0.15, 0.35) * way)
    change = with_point(lambda size: Point(at, spring=size, anchor=(x, y, z)))
    return Concealed("tether", "physics", change, 0.03, 3.0, "stiffness", "N/m", (at, at))


def support_plane(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a plane. Size: its height above the lowest point of all frames [m]."""
    low = float(setting.states[..., 2].min())
    room = float(setting.held.positions[..., 2].min()) - low
    up, radius = np.array([0.0, 0.0, 1.0]), 0.5 * setting.diameter
    # Field.reach is measured to the axis of the rope; the surface lies a radius lower.
    change = with_field(lambda size: Field(np.array([0, 0, low + size]), up, 0.0, CONTACT_HARDNESS,
                                           "plane"))  # fmt: skip
    return Concealed(
        "support_plane", "physics", change, 0.02, 0.6 * room, "height", "m",
        reported=lambda size: low + size - radius, follows=True,
    )  # fmt: skip


def obstacle(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a horizontal bar under the rope. Size: its reach above the lowest passing [m]."""
    x = setting.states[..., :3]
    bar = 0.02 + 0.5 * setting.diameter
    # Where the rope passes in at least half of the frames.
    place = float(rng.uniform(0.35, 0.65) * (x[0, -1, 0] - np.median(x[:, 0, 0]))
                  + np.median(x[:, 0, 0]))  # fmt: skip
    heading = rng.uniform(-0.2, 0.2)
    axis = np.array([-np.sin(heading), np.cos(heading), 0.0])
    across = (x - [place, 0.0, 0.0]) @ np.array([np.cos(heading), np.sin(heading), 0.0])
    # The bar's axis below all of the rope by its reach: just touching somewhere.
    near = np.abs(across) < bar
    low = float((x[..., 2] - np.sqrt(np.maximum(bar**2 - across**2, 0.0)))[near].min())

    def field(size: float) -> Field:
        return Field(np.array([place, 0, low + size]), axis, bar, CONTACT_HARDNESS, "bar")

    return Concealed(
        "obstacle", "physics", with_field(field), 0.01, 0.25, "z", "m",
        reported=lambda size: low + size, follows=True,
    )  # fmt: skip


def bending_hysteresis(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw internal friction. Size: the yield moment [N m]."""
    rod, span = setting.rod, float(rng.uniform(0.5, 2.0)) / setting.rod.length
    unit = rod.density * 9.81 * rod.length**2

    def change(world: World, size: float) -> World:
        return replace(world, law=Law(size / span, span, np.inf, fresh=False))

    return Concealed(
        "bending_hysteresis", "physics", change, 1e-4 * unit, 1e-2 * unit, "moment", "N m"
    )


def plastic_set(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw a set.

    Size: the share of the rigidity that yields, beyond half of the largest curvature.
    """
    rod = setting.rod
    span = float(rng.uniform(0.3, 0.6) * np.abs(setting.states[..., 10:]).max() / rod.bending)

    def change(world: World, size: float) -> World:
        own = replace(world.rod, bending=(1 - size) * rod.bending)
        return replace(world, rod=own, law=Law(size * rod.bending, span, np.inf, fresh=True))

    return Concealed("plastic_set", "physics", change, 0.1, 0.9, "share", "1")


def viscoelastic_creep(setting: Setting, rng: np.random.Generator) -> Concealed:
    """Draw creep. Size: the additional rigidity under quick bending, over the own one."""
    time = float(rng.uniform(1.0, 8.0)) * INTERVAL

    def change(world: World, size: float) -> World:
        return replace(world, law=Law(size * setting.rod.bending, np.inf, time, fresh=False))

    return Concealed("viscoelastic_creep", "physics", change, 0.2, 5.0, "share", "1")


PHYSICS = {
    "point_mass": point_mass, "mass_section": mass_section,
    "intrinsic_curvature": intrinsic_curvature, "kink": kink, "stiff_section": stiff_section,
    "soft_section": soft_section, "axial_extensibility": axial_extensibility,
    "distributed_load": distributed_load, "clamped_end": clamped_end, "end_twist": end_twist,
    "tether": tether, "support_plane": support_plane, "obstacle": obstacle,
}  # fmt: skip
HISTORY_DEPENDENT = {
    "bending_hysteresis": bending_hysteresis, "plastic_set": plastic_set,
    "viscoelastic_creep": viscoelastic_creep,
}  # fmt: skip
IN_MOTION = ("inertia", "damping", "time_lag")
IN_TIME = {*HISTORY_DEPENDENT, *IN_MOTION, "contact_friction"}
NEEDS_CLAMPS = {"intrinsic_curvature", "kink", "end_twist", "follower_force"}
NEEDS_PINS = {"clamped_end"}
