"""Shared by all figures: colours, axes with units, numbers kept short.

Figures are plain dictionaries of traces and axes (as Plotly names them), drawn by figures.js on the
page and by `printed` on paper. "ink", "soft", "ground" and "band" stand for the page's own colours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

# One colour each through the whole page; all show on white and on black.
RECORDED = "#8b939e"
NOMINAL = "#3288c9"
WITH_CAUSE = "#d55e00"
CAUSE = "#b8478f"
TARGET = "#009e73"
SIMULATED = "#009e73"
MANY = ["#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#999999", "#0072b2"]
DIVERGING = [  # see-through, so that the page's ink is readable on it, light or dark
    [0.0, "rgba(0,114,178,0.85)"],
    [0.5, "rgba(140,140,140,0.06)"],
    [1.0, "rgba(213,94,0,0.85)"],
]

HEIGHT = 320
MOST_COLUMNS = 300  # of a heat map
MOST_POINTS = 1500  # of a line


@dataclass
class Figure:
    """One plot.

    name: read aloud for it; title: above it, in a colour; steps: arrays of every trace, per step of
    a slider; columns: the step of the page's picture that each column of a map stands for;
    enlarged: (one trace, another, factor): the first is also drawn that much farther away from the
    second.
    """

    name: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    caption: str | Markup = ""
    height: int = HEIGHT
    steps: list[list[dict[str, Any]]] | None = field(default=None)
    title: tuple[str, str] | None = None
    columns: list[int] | None = None
    enlarged: tuple[int, int, int] | None = None

    def content(self) -> dict[str, Any]:
        """Return what the page needs to draw it."""
        more = {"steps": self.steps, "title": self.title}
        more |= {"columns": self.columns, "enlarged": self.enlarged}
        content: dict[str, Any] = {"data": self.data, "layout": self.layout}
        return content | {name: value for name, value in more.items() if value}


def numbers(values: Any, digits: int = 5) -> list[Any]:
    """Return nested lists of numbers to `digits` significant digits; None where not finite."""
    array = np.asarray(values)
    if array.ndim > 1:
        return [numbers(row, digits) for row in array]
    if array.dtype.kind in "biu":
        return array.astype(int).tolist()
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in array.tolist()]


def places(values: Any, decimals: int = 5) -> list[Any]:
    """Return coordinates in m to 1e-5 m (or pixels to 0.1 with decimals=1); None where not
    finite."""
    rounded = np.round(np.asarray(values, dtype=float), decimals).tolist()
    return [v if np.isfinite(v) else None for v in rounded]


def evenly(count: int, most: int) -> np.ndarray:
    """Return indices of at most `most` of `count` things, evenly chosen, with the first and the
    last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def thinned(count: int, most: int, noun: str = "frames") -> str:
    """Return a sentence that says so when not everything is shown."""
    return f" {most} of {count} {noun} are shown, evenly chosen." if count > most else ""


def span(values: np.ndarray, edge: float = 0.06) -> tuple[list[float], list[float]]:
    """Return ranges of u and of v (downwards) that hold all of values (..., 2), with a margin."""
    flat = values.reshape(-1, 2)
    if not np.isfinite(flat).all(axis=1).any():
        return [0.0, 1.0], [1.0, 0.0]
    low, high = np.nanmin(flat, axis=0), np.nanmax(flat, axis=0)
    edge = edge * float((high - low).max()) + 2
    return places([low[0] - edge, high[0] + edge], 1), places([high[1] + edge, low[1] - edge], 1)


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Return an axis; `title` carries the unit in brackets."""
    return {"title": title} | more


def plane(x: dict[str, Any], y: dict[str, Any], **more: Any) -> dict[str, Any]:
    """Return the layout of a flat figure."""
    return {"xaxis": x, "yaxis": y} | more


def space(low: np.ndarray, high: np.ndarray, eye: np.ndarray, up: np.ndarray) -> dict[str, Any]:
    """Return the layout of a figure in space that shows low..high (3,) [m] from the direction eye
    (3,)."""
    scene = {"low": low, "high": high, "eye": eye, "up": up}
    return {"scene": {name: numbers(value) for name, value in scene.items()}}


def path(name: str, colour: str, width: float, **more: Any) -> dict[str, Any]:
    """Return a line in space."""
    style = {"color": colour, "width": width}
    return {"type": "scatter3d", "mode": "lines", "name": name, "line": style} | more


def dots(name: str, colour: str, size: float, **marker: Any) -> dict[str, Any]:
    """Return markers in space."""
    style = {"color": colour, "size": size} | marker
    return {"type": "scatter3d", "mode": "markers", "name": name, "marker": style}


def at(x: np.ndarray) -> dict[str, Any]:
    """Return the coordinates of a trace in space, from points x (P, 3) [m]."""
    return dict(zip("xyz", map(places, np.asarray(x, dtype=float).reshape(-1, 3).T), strict=True))


def line(x: Any, y: Any, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """Return a line."""
    style = {"color": colour, "width": 2} | more.pop("line", {})
    return {
        "type": "scatter",
        "mode": "lines",
        "x": numbers(x),
        "y": numbers(y),
        "name": name,
        "line": style,
    } | more


def heat(x: Any, y: Any, z: Any, title: str, **more: Any) -> dict[str, Any]:
    """Return a heat map; blank where NaN."""
    return {
        "type": "heatmap",
        "x": numbers(x),
        "y": numbers(y),
        "z": numbers(z, 4),
        "colorscale": DIVERGING,
        "title": title,
    } | more


def by_frame(
    title: str,
    frames: np.ndarray,
    values: np.ndarray,
    name: str,
    y: dict[str, Any],
    caption: str,
    marked: tuple[np.ndarray, str, str] | None = None,
    **more: Any,
) -> Figure:
    """Return the figure of one value a frame, thinned; marked: (frames (F,), name, symbol)."""
    shown = evenly(len(frames), MOST_POINTS)
    traces = [line(frames[shown], values[shown], name, NOMINAL, **more)]
    if marked is not None and marked[0][shown].any():
        at, marks = shown[marked[0][shown]], {"color": "soft", "symbol": marked[2], "size": 9}
        traces.append(line(frames[at], values[at], marked[1], "soft", mode="markers", marker=marks))
    caption += thinned(len(frames), MOST_POINTS)
    return Figure(title, traces, plane(axis("frame"), y), caption)


def bands(blocks: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Return shaded stretches of the x axis."""
    return [{"x": [first, last], "fill": "band"} for first, last in blocks]
