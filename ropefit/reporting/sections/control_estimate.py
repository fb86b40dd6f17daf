"""Control, kind estimate: deviation per frame, its statistics, and trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Control
from ropefit.reporting.camera import broadside, image_name, project
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    MANY,
    MOST_POINTS,
    NOMINAL,
    RECORDED,
    Figure,
    at,
    axis,
    evenly,
    line,
    path,
    places,
    plane,
    space,
    span,
    thinned,
)
from ropefit.reporting.html import pair, paragraph, plot, table
from ropefit.reporting.words import number

MOST_KEYS = len(MANY)


def estimate(run: RunContents, c: Control) -> Markup:
    """Return table, deviations and trajectories."""
    body = table(["quantity", "median", "mean", "max"], _statistics(c), (1, 2, 3))
    known = np.isfinite(c.reference).all(axis=1).any()
    if not known:
        body += paragraph(
            "The recording does not say where the gripper was: no deviation can be given."
        )
    deviations = [_deviation(c, c.deviation, c.key_deviation, 1e3, "mm", c.position_sd)]
    deviations.append(_deviation(c, c.deviation_px, c.key_deviation_px, 1.0, "px"))
    body += pair(*deviations) if np.isfinite(c.deviation_px).any() else plot(deviations[0])
    return body + pair(_trajectory(run, c), _image_trajectory(run, c))


def _statistics(c: Control) -> list[list[str]]:
    rows = [
        _statistic("deviation of the control point", "mm", 1e3 * c.deviation),
        _statistic("deviation of the control point", "px", c.deviation_px),
        _statistic("deviation of key points", "mm", 1e3 * c.key_deviation),
        _statistic("deviation of key points", "px", c.key_deviation_px),
        _statistic("OBJ1", "m", c.obj1),
        _statistic("error of rope length", "%", 100 * np.abs(c.length_error)),
    ]
    return [row for row in rows if row]


def _statistic(name: str, unit: str, values: np.ndarray) -> list[str]:
    known = values[np.isfinite(values)]
    if not known.size:
        return []
    return [f"{name} ({unit})", *(number(float(f(known))) for f in (np.median, np.mean, np.max))]


def _deviation(
    c: Control,
    control: np.ndarray,
    key: np.ndarray,
    scale: float,
    unit: str,
    sd: np.ndarray | None = None,
) -> Figure:
    shown = evenly(len(c.cases), MOST_POINTS)
    traces = [line(c.cases[shown], scale * control[shown], "control point", NOMINAL)]
    for k in range(min(key.shape[1], MOST_KEYS)):
        name = f"key point {k + 1}"
        style = {"width": 1.2, "dash": "dash"}
        traces.append(line(c.cases[shown], scale * key[shown, k], name, MANY[k], line=style))
    if sd is not None and np.isfinite(sd).any():
        size = scale * np.sqrt(np.sum(sd[shown] ** 2, axis=1))
        style = {"width": 1.2, "dash": "dot"}
        traces.append(line(c.cases[shown], size, "its standard deviation", "ink", line=style))
    lost = shown[~c.converged[shown]]
    if lost.size:
        ring = {"symbol": "circle-open", "size": 8, "color": "ink"}
        traces.append(
            line(
                c.cases[lost],
                scale * control[lost],
                "not converged",
                "ink",
                mode="markers",
                marker=ring,
            )
        )
    return Figure(
        f"Deviation of the control point in every frame, in {unit}",
        traces,
        plane(axis("frame"), axis(f"deviation ({unit})", rangemode="tozero")),
        f"Distance of the estimated from the recorded point, in {unit}."
        + thinned(len(c.cases), MOST_POINTS),
    )


def _trajectory(run: RunContents, c: Control) -> Figure:
    shown = evenly(len(c.cases), MOST_POINTS)
    cloud = np.concatenate([c.position, c.reference])
    eye, up = broadside(run.observations, cloud)
    traces = [
        path("recorded", RECORDED, 4) | at(c.reference[shown]),
        path("estimated", NOMINAL, 2.5) | at(c.position[shown]),
    ]
    return Figure(
        "Trajectory of the control point in space",
        [trace for trace in traces if any(v is not None for v in trace["x"])],
        space(np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0), eye, up),
        "Trajectory of the control point in space, equal scales.",
        height=400,
    )


def _image_trajectory(run: RunContents, c: Control) -> Figure:
    view, shown = run.observations.view, evenly(len(c.cases), MOST_POINTS)
    curves = [
        (c.reference, "recorded", RECORDED, {"width": 3}),
        (c.position, "estimated", NOMINAL, {"width": 1.8}),
    ]
    for k in range(min(c.key_position.shape[1], MOST_KEYS)):
        curves.append((c.key_reference[:, k], "key points, recorded", "soft", {"width": 3}))
        style = {"width": 1.5, "dash": "dash"}
        curves.append((c.key_position[:, k], f"key point {k + 1}", MANY[k], style))
    traces: list[dict[str, Any]] = []
    ends: list[np.ndarray] = []
    for x, name, colour, style in curves:
        seen = project(view, x[shown])
        if np.isfinite(seen).any():
            new = all(trace["name"] != name for trace in traces)
            u, v = places(seen[:, 0], 1), places(seen[:, 1], 1)
            traces.append(line(u, v, name, colour, line=style, showlegend=new))
            ends.append(seen)
    across, down = span(np.concatenate([np.empty((0, 2)), *ends]))
    layout = plane(
        axis("u (px)", range=across),
        axis("v (px, downwards)", range=down, scaleanchor="x"),
    )
    caption = f"The same in the image plane. {image_name(view)}"
    return Figure("Trajectory in the image", traces, layout, caption, height=400)
