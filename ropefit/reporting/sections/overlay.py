"""Recording and simulation on top of each other, in space and in the image, frame by frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Observations, View
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    AFTER,
    BEFORE,
    OBSERVED,
    Figure,
    axis,
    evenly,
    places,
    plane,
    space,
    span,
    thinned,
)
from ropefit.reporting.html import paragraph, sequence
from ropefit.reporting.sections.base import Section

MOST_FRAMES = 60
MOST_DOTS = 200  # of one frame


class OverlaySection(Section):
    """A slider over the frames moves both figures."""

    title = "Overlay"

    def render(self, run: RunContents) -> Markup:
        o = run.observations
        shown = evenly(len(o.frames), MOST_FRAMES)
        text = (
            "Drag the slider to go through the recording, and the left figure to turn it."
            + thinned(len(o.frames), MOST_FRAMES)
        )
        figures = [_in_space(run, shown), _in_image(run, shown)]
        return paragraph(text, "note") + sequence(figures, _labels(run, shown))


def project(view: View, x: np.ndarray) -> np.ndarray:
    """(..., 2) [px] of points x (..., 3) [m]; NaN behind the camera."""
    local = (x - view.pose[:3, 3]) @ view.pose[:3, :3]
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = np.where(local[..., 2] > 1e-9, local[..., 2], np.nan)
        u = view.fx * local[..., 0] / depth + view.cx
        v = view.fy * local[..., 1] / depth + view.cy
    return np.stack([u, v], axis=-1)


def from_camera(
    o: Observations, middle: np.ndarray, far: float = 1.6
) -> tuple[np.ndarray, np.ndarray]:
    """(eye (3,), up (3,)) of a 3D figure that looks as the camera does, gravity downwards."""
    away = o.view.pose[:3, 3] - middle
    away = away / max(float(np.linalg.norm(away)), 1e-9)
    size = float(np.linalg.norm(o.gravity))
    up = -o.gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    if abs(away @ up) > 0.98:  # from straight above: the image's own up
        up = -o.view.pose[:3, 1]
    return far * away, up


def image_name(view: View) -> str:
    """What the image plane is."""
    if view.virtual:
        return "The recording has no camera: a virtual one was assumed for this view."
    return f"The image is {view.width} × {view.height} px."


def _labels(run: RunContents, shown: np.ndarray) -> list[str]:
    o, f = run.observations, run.fitted
    labels = []
    for t in shown:
        text = f"Frame {o.frames[t]}, {o.time[t]:.2f} s"
        labels.append(text + (", held out" if f is not None and f.heldout[t] else ""))
    return labels


def _dots(start: np.ndarray, t: int) -> np.ndarray:
    """Rows of frame t, at most MOST_DOTS."""
    count = int(start[t + 1] - start[t])
    return start[t] + evenly(count, MOST_DOTS) if count else np.empty(0, dtype=int)


def _few(o: Observations) -> bool:
    return len(o.points) < 60 * len(o.frames)


def _traces(kind: str, fitted: bool, few: bool) -> list[dict[str, Any]]:
    """The lines and dots of one frame; a few markers are drawn larger than a cloud."""
    deep = kind == "scatter3d"
    dot = {"size": (2.5 if deep else 5) * (1.8 if few else 1.0), "color": OBSERVED}
    traces = [{"mode": "markers", "name": "observed", "marker": dot}]
    if fitted:
        thin = {"color": BEFORE, "width": 2 if deep else 1.5}
        thick = {"color": AFTER, "width": 4 if deep else 2}
        traces.append({"mode": "lines", "name": "before", "line": thin})
        traces.append({"mode": "lines", "name": "after", "line": thick})
    mark = {"size": 4 if deep else 9, "color": "ink", "symbol": "diamond"}
    traces.append({"mode": "markers", "name": "ends", "marker": mark})
    return [{"type": kind, "hoverinfo": "skip" if deep else "x+y"} | trace for trace in traces]


def _in_space(run: RunContents, shown: np.ndarray) -> Figure:
    o, f = run.observations, run.fitted
    everything = [o.points, o.end_position.reshape(-1, 3)]
    steps = []
    for t in shown:
        lines = [] if f is None else [f.x_initial[t], f.x[t]]
        everything += lines
        parts = [o.points[_dots(o.point_start, t)], *lines, o.end_position[t]]
        steps.append([dict(zip("xyz", map(places, part.T), strict=True)) for part in parts])
    cloud = np.concatenate(everything)
    low, high = np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0)
    eye, up = from_camera(o, (low + high) / 2)
    flat = "in the plane of gravity and the two ends" if o.projected else "as measured"
    simulated = "" if f is None else " Simulated before and after the fit."
    return Figure(
        "Recording and simulation in space",
        _traces("scatter3d", f is not None, _few(o)),
        space(low, high, eye, up),
        f"In space, equal scales; observed points {flat}.{simulated}",
        height=460,
        steps=steps,
    )


def _in_image(run: RunContents, shown: np.ndarray) -> Figure:
    o, f = run.observations, run.fitted
    ends = project(o.view, o.end_position)
    everything = [o.pixels, ends.reshape(-1, 2)]
    steps = []
    for t in shown:
        lines = [] if f is None else [project(o.view, f.x_initial[t]), project(o.view, f.x[t])]
        everything += lines
        parts = [o.pixels[_dots(o.pixel_start, t)], *lines, ends[t]]
        steps.append([{"x": places(p[:, 0], 1), "y": places(p[:, 1], 1)} for p in parts])
    across, down = span(np.concatenate(everything))
    layout = plane(
        axis("u (px)", range=across, constrain="domain"),
        axis("v (px, downwards)", range=down, scaleanchor="x", constrain="domain"),
    )
    return Figure(
        "Recording and simulation in the image",
        _traces("scatter", f is not None, _few(o)),
        layout,
        f"In the image plane. {image_name(o.view)}",
        height=460,
        steps=steps,
    )
