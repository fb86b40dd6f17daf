"""What is missing, drawn where it is: an effect's symbol as lines in space.

A symbol is what `Effect.drawn` asks for; no effect is known here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ropefit.artifacts.causes import Cause, Curve
from ropefit.effects import Effect
from ropefit.effects.drawn import Drawn
from ropefit.plugins import EFFECTS, concrete
from ropefit.reporting.emblems import EMBLEMS, emblem
from ropefit.reporting.words import readable

UNIT = 0.06  # of the rope's length: how large a symbol is
ARROWS = 7  # along a stretch
GRID = 6  # lines each way, of a plane
TURN = np.linspace(0, 2 * np.pi, 33)
WHOLE = 0.9  # of the rope: a stretch as long is not marked


@dataclass(frozen=True)
class Place:
    """Where a symbol is drawn: the rope x (P, 3) at arc (P,), the stretch it acts on, the end;
    the middle of the ends (3,), upwards (3,) and sideways (3,) in the view."""

    x: np.ndarray
    arc: np.ndarray
    stretch: tuple[float, float]
    end: int | None
    middle: np.ndarray
    up: np.ndarray
    side: np.ndarray

    @property
    def size(self) -> float:
        return UNIT * float(self.arc[-1])

    def at(self, s: float) -> np.ndarray:
        return np.array([np.interp(s, self.arc, axis) for axis in self.x.T])

    @property
    def centre(self) -> np.ndarray:
        """Return (3,) the middle of the stretch, or the end."""
        return self.x[-self.end] if self.end is not None else self.at(sum(self.stretch) / 2)

    def circle(self, centre: np.ndarray, radius: float, angles: Any) -> np.ndarray:
        """Return (A, 3) points of a circle in the view at angles (A,) or one; 0 is sideways."""
        angles = np.atleast_1d(angles)
        turn = np.cos(angles)[:, None] * self.side + np.sin(angles)[:, None] * self.up
        return centre + radius * turn


def drawn_of(cause: Cause, gravity: np.ndarray) -> Drawn:
    """Return how an effect wants to be drawn: a law as its curve over what the data visit; effects
    of packages not installed as their stretch."""
    values = dict(zip(cause.value_names, map(float, cause.values), strict=True))
    for kind in concrete(Effect, EFFECTS):
        if kind.__name__ == cause.variant:
            drawn = kind(cause.end or 0).drawn(values, gravity)  # pyright: ignore[reportAbstractUsage]
            return _with_law(drawn, cause.law.curve) if cause.law and cause.law.curve else drawn
    return Drawn()


def _with_law(drawn: Drawn, c: Curve) -> Drawn:
    visited = (c.x >= c.visited[0]) & (c.x <= c.visited[1])
    curve = np.stack([c.x, c.y], axis=1)[visited]
    what = drawn.label or f"{c.name_y} over {c.name_x}"
    symbol = "graph" if drawn.symbol == "stretch" else drawn.symbol
    return replace(drawn, symbol=symbol, curve=curve if len(curve) > 1 else None, label=what)


def label_of(cause: Cause, drawn: Drawn) -> str:
    """Return the text beside a symbol."""
    size = readable(next(iter(cause.parameters.values())))
    if drawn.symbol in ("stretch", *EMBLEMS):  # which alone do not tell what it is
        size = f"{cause.name.replace('_', ' ')} {size}"
    return drawn.label or size


def band(place: Place) -> np.ndarray:
    """Return (P, 3) the rope where the effect acts; nothing where that is all of it."""
    low, high = place.stretch
    if high <= low or high - low > WHOLE * place.arc[-1]:
        return np.empty((0, 3))
    inner = place.arc[(place.arc > low) & (place.arc < high)]
    return np.stack([place.at(s) for s in (low, *inner, high)])


def strokes(drawn: Drawn, place: Place) -> tuple[np.ndarray, np.ndarray]:
    """Return the symbol's lines (P, 3), with NaN between them, and where its label begins (3,)."""
    placed = SYMBOLS.get(drawn.symbol)
    lines, label = placed(drawn, place) if placed else emblem(drawn, place)
    gap = np.full((1, 3), np.nan)
    parts = [part for line in lines for part in (np.asarray(line, dtype=float), gap)]
    return np.concatenate(parts) if parts else gap, label


Lines = tuple[list[Any], np.ndarray]


def _stretch(d: Drawn, p: Place) -> Lines:
    return [], p.centre + 0.5 * p.size * p.side


def _weight(d: Drawn, p: Place) -> Lines:
    top, u, s = p.centre - 0.8 * p.size * p.up, p.size * p.up, p.size * p.side
    box = [top - 0.3 * s, top + 0.3 * s, top + 0.5 * s - u, top - 0.5 * s - u, top - 0.3 * s]
    return [[p.centre, top], box], top + 0.5 * s - 0.5 * u


def _load(d: Drawn, p: Place) -> Lines:
    way = _unit(d.vector, -p.up) * 1.3 * p.size
    low, high = p.stretch
    foot = [p.at(s) for s in np.linspace(low, high, ARROWS + 2)[1:-1]]
    # Text runs to the right: from a short stretch's last arrow, or from the first within the loop.
    which = min if high - low > 0.5 * p.arc[-1] else max
    beside = which(foot, key=lambda x: x @ p.side)
    beside = max(beside, beside + way, key=lambda x: x @ p.side)
    return [arrow(at, way, p) for at in foot], beside + (0.4 * p.side + 0.2 * p.up) * p.size


def _arc(d: Drawn, p: Place) -> Lines:
    low, high = p.stretch
    half = min(0.5 * (high - low) / d.size, np.pi)
    away = _unit(p.centre - p.x.mean(axis=0), p.up)
    start = np.arctan2(away @ p.up, away @ p.side)
    centre = p.centre + (1.2 * p.size - d.size) * away
    curve = p.circle(centre, d.size, np.linspace(start - half, start + half, 24))
    return [curve], max(curve, key=lambda x: x @ p.side) + 0.4 * p.size * p.side


def _kink(d: Drawn, p: Place) -> Lines:
    away = _unit(p.centre - p.x.mean(axis=0), p.up) * p.size
    across = _unit(np.cross(np.cross(p.side, p.up), away), p.side) * p.size
    tip = p.centre + 0.25 * away
    return [
        [tip + 0.9 * across + 0.6 * away, tip, tip - 0.9 * across + 0.6 * away]
    ], tip + 1.6 * away


def _clamp(d: Drawn, p: Place) -> Lines:
    inner = p.x[1] - p.x[0] if p.end == 0 else p.x[-2] - p.x[-1]
    along = _unit(inner if d.vector is None else d.vector * np.sign(inner @ d.vector), p.side)
    across = _unit(np.cross(np.cross(p.side, p.up), along), p.up) * 0.4 * p.size
    foot, tip = p.centre, p.centre + 1.2 * p.size * along
    jaws = [[foot + k * across, tip + k * across] for k in (-1, 1)]
    plate = [foot - 1.6 * across, foot + 1.6 * across]
    return [*jaws, plate], tip + 0.6 * p.size * p.side


def _turn(d: Drawn, p: Place) -> Lines:
    ring = p.circle(p.centre, 0.7 * p.size, np.linspace(-0.4 * np.pi, 1.2 * np.pi, 28))
    return [ring, *_head(ring[-1], ring[-1] - ring[-2], p)], p.centre + p.size * p.side


def _arrow(d: Drawn, p: Place) -> Lines:
    way = _unit(d.vector, p.up) * 1.6 * p.size
    # Beyond the tip; above it where the text would run back over the arrow.
    lift = 0.5 * p.size * p.up if way @ p.side < -abs(way @ p.up) else 0.0
    return [arrow(p.centre, way, p)], p.centre + 1.3 * way + lift


def _tether(d: Drawn, p: Place) -> Lines:
    assert d.point is not None
    anchor = p.middle + d.point
    far = anchor - p.centre
    reach = min(float(np.linalg.norm(far)), 0.5 * p.arc[-1])
    tip = p.centre + reach * _unit(far, p.up)
    cross = 0.3 * p.size
    mark = [[tip - cross * v, tip + cross * v] for v in (p.side + p.up, p.side - p.up)]
    return [[p.centre, tip], *mark], tip + 0.4 * p.size * p.side


def _plane(d: Drawn, p: Place) -> Lines:
    assert d.point is not None
    normal, origin = _unit(d.vector, p.up), p.middle + d.point
    first = _unit(p.side - (p.side @ normal) * normal, p.up)
    second = np.cross(normal, first)
    reach = 1.1 * max(float(np.abs((p.x - origin) @ first).max()), 3 * p.size)
    wide, deep = reach * first, 0.4 * reach * second
    lines = [
        [origin + k * one - other, origin + k * one + other]
        for one, other in ((wide, deep), (deep, wide))
        for k in np.linspace(-1, 1, GRID)
    ]
    return lines, origin + reach * first - 0.5 * p.size * p.up


def _bar(d: Drawn, p: Place) -> Lines:
    assert d.point is not None
    axis, origin = _unit(d.vector, p.side), p.middle + d.point
    one = np.cross(axis, p.up)
    ring = d.size * (np.cos(TURN)[:, None] * one + np.sin(TURN)[:, None] * p.up)
    ends = [origin + share * 0.15 * p.arc[-1] * axis for share in (-1, 1)]
    sides = [[end + ring[k] for end in ends] for k in range(0, 32, 4)]
    above = d.size + 0.15 * p.arc[-1] * abs(axis @ p.up) + 0.5 * p.size
    return [*(end + ring for end in ends), *sides], origin + above * p.up


def _gravity(d: Drawn, p: Place) -> Lines:
    foot = p.middle - 2 * p.size * p.up
    long = 3.5 * p.size
    true = _unit(d.vector, -p.up) * long
    plumb = [foot, foot - long * p.up]
    return [plumb, arrow(foot, true, p)], foot + true + 0.5 * p.size * p.side


def _clock(d: Drawn, p: Place) -> Lines:
    centre = p.x[0] + 1.6 * p.size * p.up
    hands = [centre + 0.5 * p.size * p.up, centre, centre + 0.4 * p.size * p.side]
    return [p.circle(centre, 0.8 * p.size, TURN), hands], centre + 1.6 * p.size * p.up


def _centre(d: Drawn, p: Place) -> Lines:
    """Return rays from a point in space, or to it."""
    assert d.point is not None
    centre = p.middle + d.point
    far = centre - p.x.mean(axis=0)
    reach = 0.8 * p.arc[-1]  # a source farther away is drawn on the way to it
    if np.linalg.norm(far) > reach:
        centre = p.x.mean(axis=0) + reach * _unit(far, p.up)
    near, away = 0.4 * p.size, 1.2 * p.size
    lines: list[Any] = [p.circle(centre, 0.5 * near, TURN)]
    for angle in np.arange(8) * np.pi / 4:
        inner, outer = p.circle(centre, near, angle)[0], p.circle(centre, away, angle)[0]
        foot, tip = (inner, outer) if d.size > 0 else (outer, inner)
        lines.append(arrow(foot, tip - foot, p))
    return lines, centre + 1.5 * p.size * p.side


def _follower(d: Drawn, p: Place) -> Lines:
    """Return an arrow across the rope, and the turn that it takes part in."""
    along = p.at(p.stretch[1] + 0.01 * p.arc[-1]) - p.at(p.stretch[0] - 0.01 * p.arc[-1])
    across = _unit(np.cross(np.cross(p.side, p.up), along), p.up) * 1.6 * p.size
    turn = p.circle(p.centre, 0.9 * p.size, np.linspace(-0.3 * np.pi, 0.3 * np.pi, 12))
    lines = [arrow(p.centre, across, p), turn, *_head(turn[-1], turn[-1] - turn[-2], p)]
    return lines, p.centre + across + 0.3 * p.size * p.side


SYMBOLS: dict[str, Callable[[Drawn, Place], Lines]] = {
    "stretch": _stretch, "weight": _weight, "load": _load, "arc": _arc, "kink": _kink,
    "clamp": _clamp, "turn": _turn, "arrow": _arrow, "tether": _tether, "plane": _plane,
    "bar": _bar, "gravity": _gravity, "clock": _clock, "centre": _centre, "follower": _follower,
}  # fmt: skip


def arrow(foot: np.ndarray, way: np.ndarray, p: Place) -> np.ndarray:
    """Return (6, 3) one line that draws an arrow from a foot (3,)."""
    head = _head(foot + way, way, p)
    return np.stack([foot, foot + way, *head[0]])


def _head(tip: np.ndarray, way: np.ndarray, p: Place) -> list[np.ndarray]:
    back = _unit(way, p.up) * 0.35 * p.size
    across = 0.5 * np.cross(np.cross(p.side, p.up), back)
    return [np.stack([tip - back + across, tip, tip - back - across])]


def _unit(vector: np.ndarray | None, otherwise: np.ndarray) -> np.ndarray:
    size = 0.0 if vector is None else float(np.linalg.norm(vector))
    return otherwise if vector is None or size < 1e-12 else vector / size
