"""Shared by all figures: colours, axes with units, numbers kept short.

Figures are plain Plotly dictionaries. The page puts in the colours of text and grid, since it knows
whether it is light or dark; "ink", "soft" and "ground" in a trace stand for its own colours.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup

# Okabe & Ito's colour-blind safe colours that show on white and on black.
OBSERVED = "#56b4e9"
BEFORE = "#999999"
AFTER = "#d55e00"
TARGET = "#009e73"
MARK = "#cc79a7"
MANY = ["#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#999999", "#0072b2"]
SEQUENTIAL = "Viridis"
DIVERGING = [  # see-through, so that the page's ink is readable on it, light or dark
    [0.0, "rgba(213,94,0,0.6)"],
    [0.5, "rgba(140,140,140,0.06)"],
    [1.0, "rgba(0,114,178,0.6)"],
]

LEGEND = {"orientation": "h", "x": 0, "yanchor": "bottom"}
HEIGHT = 340
MOST_COLUMNS = 300  # of a heat map
MOST_POINTS = 1500  # of a line


@dataclass
class Figure:
    """One plot. name: read aloud for it; steps: arrays of every trace, per step of a slider."""

    name: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]
    caption: str | Markup = ""
    height: int = HEIGHT
    steps: list[list[dict[str, Any]]] | None = field(default=None)

    def content(self) -> dict[str, Any]:
        """What the page needs to draw it."""
        content: dict[str, Any] = {"data": self.data, "layout": self.layout}
        return content | ({"steps": self.steps} if self.steps else {})


def numbers(values: Any, digits: int = 5) -> list[Any]:
    """Nested lists of numbers to `digits` significant digits; None where not finite."""
    array = np.asarray(values)
    if array.ndim > 1:
        return [numbers(row, digits) for row in array]
    if array.dtype.kind in "biu":
        return array.astype(int).tolist()
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in array.tolist()]


def places(values: Any, decimals: int = 5) -> list[Any]:
    """Coordinates in m to 1e-5 m (or pixels to 0.1 with decimals=1); None where not finite."""
    rounded = np.round(np.asarray(values, dtype=float), decimals).tolist()
    return [v if np.isfinite(v) else None for v in rounded]


def evenly(count: int, most: int) -> np.ndarray:
    """Indices of at most `most` of `count` things, evenly chosen, with the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def thinned(count: int, most: int, noun: str = "frames") -> str:
    """A sentence that says so when not everything is shown."""
    return f" {most} of {count} {noun} are shown, evenly chosen." if count > most else ""


def span(values: np.ndarray, edge: float = 0.06) -> tuple[list[float], list[float]]:
    """Ranges of u and of v (downwards) that hold all of values (..., 2), with a margin."""
    flat = values.reshape(-1, 2)
    if not np.isfinite(flat).all(axis=1).any():
        return [0.0, 1.0], [1.0, 0.0]
    low, high = np.nanmin(flat, axis=0), np.nanmax(flat, axis=0)
    edge = edge * float((high - low).max()) + 2
    return places([low[0] - edge, high[0] + edge], 1), places([high[1] + edge, low[1] - edge], 1)


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis; `title` carries the unit in brackets."""
    return {
        "title": {"text": title, "standoff": 8},
        "automargin": True,
        "zeroline": False,
        "ticks": "outside",
        "ticklen": 4,
        "showline": True,
    } | more


def plane(x: dict[str, Any], y: dict[str, Any], **more: Any) -> dict[str, Any]:
    """The layout of a flat figure."""
    return {
        "xaxis": x,
        "yaxis": y,
        "margin": {"l": 56, "r": 12, "t": 34, "b": 46},
        "legend": LEGEND | {"y": 1.02},
        "hovermode": "closest",
    } | more


def space(low: np.ndarray, high: np.ndarray, eye: np.ndarray, up: np.ndarray) -> dict[str, Any]:
    """The layout of a 3D figure of equal aspect that shows low..high (3,) [m] from `eye` (3,)."""
    middle, size = (low + high) / 2, high - low
    size = np.maximum(size * 1.08, 0.2 * max(float(size.max()), 1e-6))
    share = size / size.max()
    scene: dict[str, Any] = {
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", numbers(share), strict=True)),
        "camera": {
            "eye": dict(zip("xyz", numbers(eye), strict=True)),
            "up": dict(zip("xyz", numbers(up), strict=True)),
        },
        "dragmode": "orbit",
    }
    for i, name in enumerate("xyz"):
        scene[f"{name}axis"] = {
            "title": {"text": f"{name} (m)"},
            "range": numbers([middle[i] - size[i] / 2, middle[i] + size[i] / 2]),
            "nticks": max(2, round(5 * share[i])),
        }
    return {
        "scene": scene,
        "margin": {"l": 0, "r": 0, "t": 34, "b": 0},
        "legend": LEGEND | {"y": 1.0, "itemsizing": "constant"},
        "uirevision": "keep",
    }


def line(x: Any, y: Any, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """A line."""
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
    """A heat map; blank where NaN."""
    return {
        "type": "heatmap",
        "x": numbers(x),
        "y": numbers(y),
        "z": numbers(z, 4),
        "colorscale": SEQUENTIAL,
        "hoverongaps": False,
        "colorbar": {"title": {"text": title, "side": "right"}, "thickness": 10, "outlinewidth": 0},
    } | more


def bands(blocks: list[tuple[float, float]]) -> list[dict[str, Any]]:
    """Shaded stretches of the x axis."""
    return [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": first,
            "x1": last,
            "y0": 0,
            "y1": 1,
            "fillcolor": "band",
            "opacity": 0.16,
            "line": {"width": 0},
            "layer": "below",
        }
        for first, last in blocks
    ]
