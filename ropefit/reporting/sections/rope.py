"""The rope as recorded and as simulated, with what is missing drawn where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis, Observations
from ropefit.reporting.answer import under_it
from ropefit.reporting.camera import broadside
from ropefit.reporting.compared import MOST_FRAMES, Compared, compared
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    NOMINAL,
    RECORDED,
    SIMULATED,
    WITH_CAUSE,
    Figure,
    at,
    dots,
    evenly,
    path,
    space,
    thinned,
)
from ropefit.reporting.html import paragraph, sequence
from ropefit.reporting.missing import forced, missing
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import number

MOST_DOTS = 160  # of one frame
SMOOTH = 6  # points drawn for each of a rope's segments
FEW_POINTS = 60  # points a frame: drawn larger than a cloud
VISIBLE = 0.04  # of the rope's length that the models should differ by to be distinguished by eye
FACTORS = (2, 5, 10, 20, 50, 100)


class RopeSection(Section):
    """One large picture: recorded, nominal, with the cause; a slider over the frames."""

    title = ""

    def render(self, run: RunContents) -> Markup:
        o, c = run.observations, compared(run)
        shown = evenly(len(o.frames), MOST_FRAMES) if c is None else c.at[c.shown]
        body = Markup('<div class="lead">{}</div>').format(
            Markup("").join(map(paragraph, under_it(run)))
        )
        labels = [_label(run, t) for t in shown]
        start = 0 if c is None else int(np.searchsorted(c.shown, c.worst))
        return body + sequence([_picture(run, shown, c)], labels, start, main=True)


def smooth(arc: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return (N, P, 3) a smooth curve through nodes x (N, K, 3) at arc (K,)."""
    from scipy.interpolate import CubicSpline

    spline: Any = CubicSpline(arc, x, axis=1)
    return spline(finer(arc))


def finer(arc: np.ndarray) -> np.ndarray:
    """Return (P,) the arc lengths at which a smooth rope is drawn."""
    return np.linspace(arc[0], arc[-1], SMOOTH * (len(arc) - 1) + 1)


def _label(run: RunContents, t: int) -> str:
    o, f = run.observations, run.fitted
    text = f"Frame {o.frames[t]}" + ("" if o.time is None else f", {o.time[t]:.2f} s")
    return text + (", held out" if f is not None and f.heldout[t] else "")


def _dots(start: np.ndarray, t: int) -> np.ndarray:
    """Return rows of frame t, at most MOST_DOTS."""
    count = int(start[t + 1] - start[t])
    return start[t] + evenly(count, MOST_DOTS) if count else np.empty(0, dtype=int)


def _picture(run: RunContents, shown: np.ndarray, c: Compared | None) -> Figure:
    o, d = run.observations, run.diagnosis
    recorded = [o.points[_dots(o.point_start, t)] for t in shown]
    size = 9.0 if len(o.points) < FEW_POINTS * len(o.frames) else 4.0
    traces, frames = [dots("recorded", RECORDED, size)], [recorded]
    everything = [o.points, o.end_position[shown].reshape(-1, 3)]
    enlarged, words = None, "Drag to turn it, double-click to turn it back."
    if c is not None:
        arc = o.node_arc
        ropes = [smooth(arc, x[c.shown]) for x in (c.nominal, c.with_cause) if x is not None]
        # The second is drawn on the first, and thinner: both are seen where they are equal.
        lines = [path("nominal", NOMINAL, 4), path("with the cause", WITH_CAUSE, 2)]
        drawn = list(zip(lines, ropes, strict=False))
        if d is not None and d.simulation is not None and np.isfinite(d.simulation.x).all():
            other = smooth(arc, d.simulation.x[c.shown])
            drawn.append((path("the simulation", SIMULATED, 3), other))
        for trace, x in drawn:
            traces.append(trace)
            frames.append(list(x))
            everything.append(x.reshape(-1, 3))
        if len(ropes) > 1:
            enlarged = (1, 2, _factor(ropes[0] - ropes[1], float(arc[-1])))
        eye, up = broadside(o, np.concatenate(everything))
        if d is not None:
            more = missing(d, o, c.shown, finer(arc), ropes[-1], np.cross(up, eye))
            for trace, steps in more:
                traces.append(trace)
                frames.append(steps)
                everything += steps
        words = _text(c, d, o) + words
    else:
        eye, up = broadside(o, o.points)
    traces.append(dots("ends", "ink", 9, symbol="diamond"))
    frames.append([o.end_position[t] for t in shown])
    cloud = np.concatenate(everything)
    return Figure(
        "The rope as recorded and as simulated, with what is missing",
        traces,
        space(np.nanmin(cloud, axis=0), np.nanmax(cloud, axis=0), eye, up),
        words + thinned(len(o.frames), len(shown)),
        height=540,
        steps=[[at(frame[t]) for frame in frames] for t in range(len(shown))],
        enlarged=enlarged,
    )


def _factor(gap: np.ndarray, length: float) -> int:
    """Return how many times the models' difference is drawn to be seen."""
    largest = float(np.linalg.norm(gap, axis=-1).max())
    return next((k for k in FACTORS if k * largest >= VISIBLE * length), FACTORS[-1])


def _text(c: Compared, d: Diagnosis | None, o: Observations) -> str:
    """Return what the picture shows, as far as that is not plain."""
    words = f"Frame {o.frames[c.at[c.worst]]} is where the nominal model is farthest off. "
    if d is None:
        return words
    if d.causes:
        words += "Drawn in purple: what is missing"
        if any("arc_length" in k.value_names for k in d.causes.values()):
            words += "; the broad line is its 95 % interval along the rope"
        words += ". "
    if forced(d):
        words += (
            f"Arrows: the force per length that would explain what is left, at most "
            f"{number(float(np.linalg.norm(d.force, axis=-1).max()))} N/m; drawn where it is "
            "beyond its standard error. "
        )
    return words
