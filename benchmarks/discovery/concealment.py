"""What a concealed effect is, and the ways in which one changes the true world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.discovery.setting import World
from reference_simulators.rod_equations import Field, Point, Rod, Section


@dataclass(frozen=True)
class Concealed:
    """One thing that is true and not in the recording; `change` applies it at a size.

    `parameter` and `unit` name the size as the tool would report it (`reported` of the size).
    """

    name: str
    kind: str  # physics, measurement, unknown
    change: Callable[[World, float], World]
    start: float  # a first guess of the size
    most: float  # the largest plausible size
    parameter: str
    unit: str
    place: tuple[float, float] | None = None  # m, arc length it acts on
    reported: Callable[[float], float] = float
    follows: bool = False  # must be grown from small sizes


def with_point(point: Callable[[float], Point]) -> Callable[[World, float], World]:
    def change(world: World, size: float) -> World:
        return replace(world, rod=replace(world.rod, points=(*world.rod.points, point(size))))

    return change


def with_section(section: Callable[[float], Section]) -> Callable[[World, float], World]:
    def change(world: World, size: float) -> World:
        rod = replace(world.rod, sections=(*world.rod.sections, section(size)))
        return replace(world, rod=rod)

    return change


def with_rod(**changes: Callable[[Rod, float], object]) -> Callable[[World, float], World]:
    def change(world: World, size: float) -> World:
        new = {name: make(world.rod, size) for name, make in changes.items()}
        return replace(world, rod=replace(world.rod, **new))  # pyright: ignore[reportArgumentType]

    return change


def with_field(field: Callable[[float], Field]) -> Callable[[World, float], World]:
    def change(world: World, size: float) -> World:
        return replace(world, rod=replace(world.rod, fields=(*world.rod.fields, field(size))))

    return change


def interval(rod: Rod, rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    """Draw an interval of arc length [m], of low to high of the length, away from the ends."""
    width = rng.uniform(low, high)
    start = rng.uniform(0.12, 0.88 - width)
    return start * rod.length, (start + width) * rod.length
