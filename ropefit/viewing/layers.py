"""What a viewer shows of each frame, whichever viewer it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ropefit.reporting.contents import RunContents

OBSERVED, BEFORE, AFTER, WITH_CAUSES, ENDS = (
    (86, 180, 233), (153, 153, 153), (213, 94, 0), (204, 121, 167), (240, 228, 66)
)  # fmt: skip


@dataclass(frozen=True)
class Layer:
    """One thing in one frame: points (N, 3) [m], joined to a line or not, colour (r, g, b), radius
    [m]."""

    name: str
    points: np.ndarray
    line: bool
    colour: tuple[int, int, int]
    radius: float


def frames(run: RunContents) -> Iterator[tuple[int, float, list[Layer]]]:
    """Return (frame number, time [s], layers) of every frame; without times, the number stands for
    it. A layer without points is there, empty."""
    o, f, d = run.observations, run.fitted, run.diagnosis
    thick = 0.5 * (o.diameter or 0.004)
    dot = 0.3 * thick
    for t, frame in enumerate(o.frames):
        layers = [
            Layer(
                "observed", o.points[o.point_start[t] : o.point_start[t + 1]], False, OBSERVED, dot
            )
        ]
        if f is not None:
            layers.append(Layer("before the fit", f.x_initial[t], True, BEFORE, 0.5 * thick))
            layers.append(Layer("after the fit", f.x[t], True, AFTER, thick))
        if d is not None and d.causes:
            at = np.flatnonzero(d.frames == frame)
            x = d.x_after[at[0]] if at.size else np.empty((0, 3))
            layers.append(Layer("with the cause", x, True, WITH_CAUSES, thick))
        ends = o.end_position[t]
        held = ends[np.isfinite(ends).all(axis=1)]
        layers.append(Layer("ends", held, False, ENDS, 2 * thick))
        yield int(frame), float(frame if o.time is None else o.time[t]), layers
