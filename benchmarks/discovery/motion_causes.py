"""What is concealed in recordings in motion, and what they tell wrongly (`motions.py`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.discovery.concealed import CONTACT_HARDNESS, interval
from benchmarks.discovery.setting import Setting, World
from reference_simulators.rod_equations import Field, Point, Section


@dataclass(frozen=True)
class Told:
    """What a recording tells wrongly: length and gravity by factors, gravity's direction by an
    angle [rad], the ends by a lag [s], the clamp of end 0 by a rotation vector in its frame
    [rad]."""

    length: float = 1.0
    gravity: float = 1.0
    gravity_tilt: float = 0.0
    lag: float = 0.0
    clamp: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Concealed:
    """What is concealed: the names that count as found, the size by key, and where [m]; drag: the
    power of the speed with which the medium's drag grows; above_ends: the size is a height [m],
    told against the middle of the ends."""

    names: tuple[str, ...]
    key: str
    size: float
    place: tuple[float, float] | None = None
    drag: float = 1.0
    above_ends: bool = False


GRIPPED = "gripped"  # of the cases: both ends are clamped, and one is turned, too
FIRST_POSES = [0, 4, 8]  # of the setting's frames: about which the clips are shaken

Drawn = tuple[World, Told, Concealed | None]


def nothing(s: Setting, rng: np.random.Generator) -> Drawn:
    return s.world, Told(), None


def point_mass(s: Setting, rng: np.random.Generator) -> Drawn:
    at = s.rod.length * float(rng.uniform(0.25, 0.75))
    mass = s.rod.density * s.rod.length * float(rng.uniform(0.08, 0.3))
    rod = replace(s.rod, points=(Point(at, mass=mass),))
    return replace(s.world, rod=rod), Told(), Concealed(("point_mass",), "mass", mass, (at, at))


def mass_section(s: Setting, rng: np.random.Generator) -> Drawn:
    a, b = interval(s.rod, rng, 0.15, 0.3)
    factor = float(rng.uniform(2.0, 3.5))
    rod = replace(s.rod, sections=(Section(a, b, density=factor),))
    mass = (factor - 1) * s.rod.density * (b - a)
    return replace(s.world, rod=rod), Told(), Concealed(("mass_section",), "mass", mass, (a, b))


def stiff_section(s: Setting, rng: np.random.Generator) -> Drawn:
    a, b = interval(s.rod, rng, 0.15, 0.3)
    factor = float(rng.uniform(5.0, 12.0))
    rod = replace(s.rod, sections=(Section(a, b, bending=factor),))
    return (
        replace(s.world, rod=rod),
        Told(),
        Concealed(("stiff_section",), "factor", factor, (a, b)),
    )


def length(s: Setting, rng: np.random.Generator) -> Drawn:
    excess = float(rng.choice([-1, 1]) * rng.uniform(0.015, 0.04))
    return s.world, Told(length=1 / (1 + excess)), Concealed(("length_error",), "excess", excess)


def gravity_scale(s: Setting, rng: np.random.Generator) -> Drawn:
    excess = float(rng.choice([-0.3, 0.4]) * rng.uniform(0.7, 1.2))
    return s.world, Told(gravity=1 / (1 + excess)), Concealed(("weight_error",), "excess", excess)


def gravity_tilt(s: Setting, rng: np.random.Generator) -> Drawn:
    angle = float(np.radians(rng.uniform(2.5, 5.0)))
    return s.world, Told(gravity_tilt=angle), Concealed(("gravity_misalignment",), "angle", angle)


def time_lag(s: Setting, rng: np.random.Generator) -> Drawn:
    lag = float(rng.choice([-1, 1]) * rng.uniform(0.025, 0.04))
    return s.world, Told(lag=lag), Concealed(("time_lag",), "lag", lag)


def drag(s: Setting, rng: np.random.Generator) -> Drawn:
    power = float(rng.choice([0.3, 1.6, 2.0, 2.4]) + rng.uniform(-0.1, 0.1))
    return s.world, Told(), Concealed(("drag_law",), "n", power, drag=power)


def drag_power(s: Setting, rng: np.random.Generator) -> Drawn:
    """Draw an exponent of 1.2 to 2; nearer to 1 no law is to be seen."""
    power = float(rng.uniform(1.2, 2.0))
    return s.world, Told(), Concealed(("drag_law",), "n", power, drag=power)


def tether(s: Setting, rng: np.random.Generator) -> Drawn:
    weight = 9.81 * s.rod.density * s.rod.length
    at = s.rod.length * float(rng.uniform(0.3, 0.7))
    stiffness = weight / s.rod.length * float(rng.uniform(0.3, 1.0))
    ends = s.world.held.positions[0].mean(axis=0)
    x, y, z = ends + s.rod.length * rng.uniform([-0.4, -0.4, -0.6], [0.4, 0.4, -0.2])
    point = Point(at, spring=stiffness, anchor=(float(x), float(y), float(z)))
    rod = replace(s.rod, points=(point,))
    return (
        replace(s.world, rod=rod), Told(),
        Concealed(("tether",), "stiffness", stiffness, (at, at)),
    )  # fmt: skip


def table(s: Setting, rng: np.random.Generator) -> Drawn:
    """Put a plane under the rope, which lies on it in at least half of the first poses."""
    heights = s.states[:, :, 2].min(axis=1)[FIRST_POSES]
    height = float(np.median(heights)) + s.rod.length * float(rng.uniform(0.01, 0.06))
    up = np.array([0.0, 0.0, 1.0])
    plane = Field(np.array([0.0, 0.0, height]), up, 0.0, CONTACT_HARDNESS, "plane")
    return (
        replace(s.world, rod=replace(s.rod, fields=(plane,))), Told(),
        Concealed(("support_plane",), "height", height, above_ends=True),
    )  # fmt: skip


def bar(s: Setting, rng: np.random.Generator) -> Drawn:
    """Put a thick horizontal bar across and under the rope, which lies on it likewise."""
    x, reach = s.states[FIRST_POSES, :, :3], float(rng.uniform(0.04, 0.08))
    place = float((x[:, 0, 0] + rng.uniform(0.4, 0.6) * (x[:, -1, 0] - x[:, 0, 0])).mean())
    across = x[..., 0] - place
    rise = np.sqrt(np.maximum(reach**2 - across**2, 0.0))
    lows = np.where(np.abs(across) < reach, x[..., 2] - rise, np.inf).min(axis=1)
    height = float(np.median(lows)) + s.rod.length * float(rng.uniform(0.01, 0.05))
    axis = np.array([0.0, 1.0, 0.0])
    one = Field(np.array([place, 0.0, height]), axis, reach, CONTACT_HARDNESS, "bar")
    return (
        replace(s.world, rod=replace(s.rod, fields=(one,))), Told(),
        Concealed(("obstacle",), "z", height, above_ends=True),
    )  # fmt: skip


def clamp(s: Setting, rng: np.random.Generator) -> Drawn:
    """Tell the clamp of end 0 askew, by 5 to 9 degrees about an axis across the rope."""
    size, about = float(np.radians(rng.uniform(5, 9))), float(rng.uniform(0, 2 * np.pi))
    tilt = (size * float(np.cos(about)), size * float(np.sin(about)), 0.0)
    return s.world, Told(clamp=tilt), Concealed(("clamped_end", "end_offset"), "tilt", size)


Cause = Callable[[Setting, np.random.Generator], Drawn]
CAUSES: dict[str, tuple[Cause, ...]] = {
    "standard": (
        nothing, point_mass, time_lag, mass_section, gravity_tilt, length, stiff_section,
        gravity_scale,
    ),
    "forces": (nothing, drag, tether, drag),
    "contact": (nothing, table, bar, table),
    "laws": (drag_power,),
    GRIPPED: (
        nothing, point_mass, time_lag, mass_section, gravity_tilt, length, stiff_section,
        gravity_scale, clamp,
    ),
}  # fmt: skip
