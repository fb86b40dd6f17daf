"""Symbols of what has no place on the rope: they stand above the middle of its ends, under their
labels. Each is lines (P, 3) in the plane of the view."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ropefit.effects.drawn import Drawn

ABOVE = 2.2  # sizes: how far above the ends an emblem stands
TICKS = np.linspace(-1.5, 1.5, 7)
COILS = 6  # of a spring
CIRCLE = np.linspace(0, 2 * np.pi, 17)
SAMPLES = 24  # of a curve

Points = list[tuple[float, float]]
Emblem = Callable[[Drawn], list[Any]]


def emblem(drawn: Drawn, place: Any) -> tuple[list[np.ndarray], np.ndarray]:
    """Return lines in space and the label's place (3,) of an emblem; place: `glyphs.Place`."""
    centre = 0.5 * (place.x[0] + place.x[-1]) + ABOVE * place.size * place.up
    lines = [
        centre + place.size * (np.asarray(flat) @ np.stack([place.side, place.up]))
        for flat in EMBLEMS[drawn.symbol](drawn)
    ]
    return lines, centre + place.size * (2.0 * place.up - 1.5 * place.side)


def _ruler(_: Drawn) -> list[Points]:
    ticks = [[(x, 0.0), (x, 0.35 if k % 2 else 0.6)] for k, x in enumerate(TICKS)]
    return [[(-1.5, 0.0), (1.5, 0.0)], *ticks]


def _camera(_: Drawn) -> list[Points]:
    body = [(-1.2, -0.5), (0.5, -0.5), (0.5, 0.5), (-1.2, 0.5), (-1.2, -0.5)]
    return [body, [(0.5, 0.15), (1.1, 0.5), (1.1, -0.5), (0.5, -0.15)]]


def _spring(_: Drawn) -> list[Points]:
    coils = [(-1.0 + 2.0 * k / COILS, 0.4 * (-1) ** k) for k in range(1, COILS)]
    return [[(-1.5, 0.0), (-1.0, 0.0), *coils, (1.0, 0.0), (1.5, 0.0)]]


def _dashpot(_: Drawn) -> list[Points]:
    cylinder = [(0.9, 0.45), (-0.5, 0.45), (-0.5, -0.45), (0.9, -0.45)]
    return [
        cylinder,
        [(-1.5, 0.0), (-0.5, 0.0)],
        [(0.2, 0.3), (0.2, -0.3)],
        [(0.2, 0.0), (1.5, 0.0)],
    ]


def _swing(_: Drawn) -> list[Points]:
    """Return a weight on a string, on its way."""
    string = [(0.0, 1.0), (0.8, -0.4)]
    bob = [(0.8 + 0.25 * np.cos(a), -0.4 + 0.25 * np.sin(a)) for a in CIRCLE]
    way = [(1.6 * np.sin(a), 1.0 - 1.6 * np.cos(a)) for a in np.linspace(-0.6, 0.2, SAMPLES)]
    return [string, bob, way, [(-0.75, -0.05), way[0], (-0.55, -0.5)]]


def _mesh(_: Drawn) -> list[Points]:
    """Return a polygon for a curve."""
    angles = np.linspace(np.pi, 2 * np.pi, SAMPLES)
    curve = [(1.2 * np.cos(a), 0.6 + 1.2 * np.sin(a)) for a in angles]
    return [curve, [curve[0], curve[SAMPLES // 3], curve[2 * SAMPLES // 3], curve[-1]]]


def _axes() -> list[Points]:
    return [[(-1.2, 0.9), (-1.2, -0.6), (1.2, -0.6)]]


def _loop(_: Drawn) -> list[Points]:
    """Return the ways of what is bent and let go."""
    u = np.linspace(0, 1, SAMPLES)
    there = [(-1.1 + 2.1 * x, -0.5 + 1.3 * x**0.5) for x in u]
    back = [(-0.5 + 1.5 * x, -0.5 + 1.3 * x**2) for x in u]
    return [*_axes(), there, back]


def _graph(d: Drawn) -> list[Points]:
    """Return the curve of the law that was found."""
    if d.curve is None:
        return _loop(d)
    low, high = d.curve.min(axis=0), d.curve.max(axis=0)
    share = (d.curve - low) / np.where(high > low, high - low, 1.0)
    return [*_axes(), [(-1.1 + 2.2 * x, -0.5 + 1.3 * y) for x, y in share]]


EMBLEMS: dict[str, Emblem] = {
    "ruler": _ruler, "camera": _camera, "spring": _spring, "dashpot": _dashpot, "swing": _swing,
    "mesh": _mesh, "loop": _loop, "graph": _graph,
}  # fmt: skip
