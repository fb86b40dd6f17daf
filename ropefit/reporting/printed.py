"""The report's figures for papers: SVG, PDF or PNG at column width, drawn by matplotlib.

The figures are the plain dictionaries that the page draws: lines, markers, bars, heat maps, lines,
markers and text in space. A figure with a slider is drawn at its first, middle and last frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import StageFailed
from ropefit.reporting.figures import Figure
from ropefit.reporting.words import slug

COLUMN = 86 / 25.4  # inches: one column of most journals
RESOLUTION = 300  # dots per inch, of PNG
NAMED = {"ink": "black", "soft": "#626a75", "ground": "white", "band": "#626a75"}
MARKERS = {"diamond": "D", "diamond-open": "D", "circle-open": "o", "x": "x", "square": "s"}
DASHES = {"dot": ":", "dash": "--"}
STYLE: dict[Any, Any] = {
    "font.size": 7, "axes.linewidth": 0.6, "lines.linewidth": 1.0, "legend.fontsize": 6,
    "legend.frameon": False, "svg.fonttype": "none", "pdf.fonttype": 42, "axes.unicode_minus": True,
    "svg.hashsalt": "ropefit",
}  # fmt: skip
SAME = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}  # the same bytes each time


def print_figures(
    figures: list[Figure],
    folder: Path,
    kinds: list[str],
    progress: Callable[[float, str], None] = lambda share, text: None,
) -> list[Path]:
    """Write every figure as every kind (svg, pdf, png) and return the paths.

    Raises StageFailed where matplotlib is missing or the folder cannot be written.
    """
    try:
        import matplotlib
    except ImportError:
        raise StageFailed("figures need matplotlib; run pip install 'ropefit[figures]'")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(STYLE):
            for number, figure in enumerate(figures, start=1):
                progress(number / len(figures), figure.name)
                for suffix, traces in _frames(figure):
                    drawn = _draw(figure, traces)
                    for kind in kinds:
                        path = folder / f"{number:02d}-{slug(figure.name)[:50]}{suffix}.{kind}"
                        drawn.savefig(path, dpi=RESOLUTION, metadata=SAME[kind])
                        written.append(path)
                    pyplot.close(drawn)
    except OSError as error:
        raise StageFailed(f"cannot write {folder}: {error.strerror or error}")
    return written


def _frames(figure: Figure) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Return a suffix for the file's name, and the traces as they are then."""
    if not figure.steps:
        yield "", figure.data
        return
    for step in sorted({0, len(figure.steps) // 2, len(figure.steps) - 1}):
        arrays = figure.steps[step]
        yield f"-{step}", [a | b for a, b in zip(figure.data, arrays, strict=True)]


def _draw(figure: Figure, traces: list[dict[str, Any]]) -> Any:
    from matplotlib import pyplot

    deep = "scene" in figure.layout
    size = (COLUMN, COLUMN * (0.85 if deep else 0.62))
    canvas, axes = pyplot.subplots(
        figsize=size, layout="constrained", subplot_kw={"projection": "3d"} if deep else {}
    )
    for trace in traces:
        kind = trace["type"]
        if kind == "heatmap":
            _heat(canvas, axes, trace)
        elif kind == "bar":
            _bars(axes, trace, traces)
        else:
            _line(axes, trace, deep)
    if figure.title:
        axes.set_title(_text(figure.title[0]), color=_colour(figure.title[1]), loc="left")
    if deep:
        _space(axes, figure.layout["scene"])
    else:
        _plane(axes, figure.layout)
    names = [h for h in axes.get_legend_handles_labels()[1] if h]
    if names and figure.layout.get("showlegend", len(names) > 1):
        canvas.legend(loc="outside upper left", ncols=2)
    return canvas


def _line(axes: Any, trace: dict[str, Any], deep: bool) -> None:
    line, marker, mode = trace.get("line", {}), trace.get("marker", {}), trace.get("mode", "lines")
    style: dict[str, Any] = {"linestyle": "none"}
    if "lines" in mode:
        style = {
            "linestyle": DASHES.get(line.get("dash", ""), "-"),
            "linewidth": 0.5 * line.get("width", 2),
            "alpha": line.get("opacity", 1.0),
        }
    colour = _colour(line.get("color", marker.get("color", "ink")))
    if mode == "text":
        for k, text in enumerate(trace["text"]):
            axes.text(*(trace[axis][k] for axis in "xyz"), f"  {text}", color=colour)
        return
    if "markers" in mode:
        symbol = marker.get("symbol", "circle")
        hollow = "open" in symbol
        style |= {
            "marker": MARKERS.get(symbol, "o"),
            "markersize": 0.5 * marker.get("size", 5),
            "alpha": marker.get("opacity", 1.0),
            "markerfacecolor": "none" if hollow else _colour(marker.get("color", colour)),
            "markeredgecolor": _colour(marker.get("color", colour)),
            "markeredgewidth": 0.6,
        }
    data = [_numbers(trace[k]) for k in ("xyz" if deep else "xy")]
    shown = trace.get("showlegend", True)
    axes.plot(*data, color=colour, label=_text(trace.get("name", "")) if shown else "", **style)


def _bars(axes: Any, trace: dict[str, Any], traces: list[dict[str, Any]]) -> None:
    mine, count = traces.index(trace), len(traces)
    colours = trace["marker"]["color"]
    colours = [_colour(c) for c in colours] if isinstance(colours, list) else _colour(colours)
    draw, names, values = axes.bar, trace["x"], trace["y"]
    ticks = axes.set_xticks
    if trace.get("orientation") == "h":
        draw, names, values, ticks = axes.barh, trace["y"], trace["x"], axes.set_yticks
    place = np.arange(len(names)) + (mine - (count - 1) / 2) * 0.8 / count
    draw(place, values, 0.8 / count, color=colours, label=_text(trace.get("name", "")))
    ticks(np.arange(len(names)), [_text(str(n)).replace("_", " ") for n in names])


def _heat(canvas: Any, axes: Any, trace: dict[str, Any]) -> None:
    from matplotlib.colors import LinearSegmentedColormap

    stops = [(at, _colour(colour)) for at, colour in trace["colorscale"]]
    scale = LinearSegmentedColormap.from_list("scale", stops)
    x, y, z = (np.array(trace[k], dtype=float) for k in "xyz")
    if z.size == 0:
        return
    image = axes.pcolormesh(
        x, y, np.ma.masked_invalid(z), cmap=scale, shading="nearest", rasterized=True,
        vmin=trace.get("zmin"), vmax=trace.get("zmax"),
    )  # fmt: skip
    if trace.get("showscale", True):
        canvas.colorbar(image, ax=axes, label=_text(trace["title"]))
    if trace.get("numbered"):
        for i, j in np.argwhere(np.isfinite(z)):
            axes.text(x[j], y[i], f"{z[i, j]:.2f}", ha="center", va="center")


def _plane(axes: Any, layout: dict[str, Any]) -> None:
    for name, its in (("x", axes.xaxis), ("y", axes.yaxis)):
        given = layout[f"{name}axis"]
        its.set_label_text(_text(given["title"]))
        if given.get("type") == "log":
            getattr(axes, f"set_{name}scale")("log")
        if "range" in given and given.get("type") != "log":
            getattr(axes, f"set_{name}lim")(given["range"])
        if given.get("rangemode") == "tozero" and "range" not in given:
            getattr(axes, f"set_{name}lim")(**{"left" if name == "x" else "bottom": 0})
        if "tickvals" in given:
            its.set_ticks(given["tickvals"], [_text(str(t)) for t in given["ticktext"]])
        if given.get("reversed"):
            its.set_inverted(True)
    if "scaleanchor" in layout["yaxis"]:
        axes.set_aspect("equal", adjustable="box")
    for band in layout.get("shapes", ()):
        if "fill" in band:
            axes.axvspan(*band["x"], color=_colour(band["fill"]), alpha=0.16, lw=0)
        else:
            (left, right), (low, high) = band["x"], band["y"]
            axes.plot([left, right, right, left, left], [low, low, high, high, low], color="black")


def _space(axes: Any, scene: dict[str, Any]) -> None:
    from matplotlib.ticker import MaxNLocator

    low, high, eye = (np.array(scene[name]) for name in ("low", "high", "eye"))
    size = np.maximum(1.08 * (high - low), 0.2 * max(float((high - low).max()), 1e-6))
    for k, name in enumerate("xyz"):
        middle = (low[k] + high[k]) / 2
        getattr(axes, f"set_{name}label")(f"{name} (m)")
        getattr(axes, f"set_{name}lim")([middle - size[k] / 2, middle + size[k] / 2])
        ticks = max(2, round(5 * size[k] / size.max()))
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(ticks))
    axes.set_box_aspect(size / size.max(), zoom=1.15)
    flat = float(np.hypot(eye[0], eye[1]))
    axes.view_init(np.degrees(np.arctan2(eye[2], flat)), np.degrees(np.arctan2(eye[1], eye[0])))


def _numbers(values: list[Any]) -> Any:
    """Return numbers with NaN for gaps; names stay names."""
    return values if any(isinstance(v, str) for v in values) else np.array(values, dtype=float)


def _colour(name: str) -> Any:
    """Return a colour as matplotlib takes it."""
    if name.startswith("rgba("):
        r, g, b, a = (float(part) for part in name[5:-1].split(","))
        return (r / 255, g / 255, b / 255, a)
    return NAMED.get(name, name)


def _text(html: str) -> str:
    """Return small HTML as matplotlib's small mathematics."""
    text = re.sub(r"<sub>(.*?)</sub>", r"$_{\\mathrm{\1}}$", html.replace("$", r"\$"))
    text = re.sub(r"<sup>(.*?)</sup>", r"$^{\\mathrm{\1}}$", text)
    return unescape(re.sub(r"<[^>]+>", "", text))
