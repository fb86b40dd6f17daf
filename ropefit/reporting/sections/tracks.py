"""Markers one by one: where they were, and where the simulation has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.reporting.camera import upwards
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    MANY,
    MOST_POINTS,
    Figure,
    axis,
    bands,
    evenly,
    line,
    plane,
    thinned,
)
from ropefit.reporting.html import plot
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.fit import heldout_bands
from ropefit.reporting.words import blocks, metres, millimetres

TRACKED, MOST_DOTS = 3, 60
FAST = 0.5  # s: frames farther apart are poses, not a motion


class TracksSection(Section):
    """A few markers from first frame to last."""

    title = "Predicted and recorded"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None and run.observations.source == "markers"

    def render(self, run: RunContents) -> Markup:
        o, f = run.observations, run.fitted
        assert f is not None
        return plot(_tracks(o, f, run.diagnosis))


def _tracks(o: Observations, f: FittedModel, d: Diagnosis | None) -> Figure:
    arcs = np.unique(o.point_arc)
    inner = arcs[1:-1] if len(arcs) > TRACKED else arcs
    chosen = inner[evenly(len(inner), TRACKED + 2)[1:-1]] if len(inner) > TRACKED else inner
    along, moving = o.frames.astype(float), False
    if o.time is not None and len(o.time) > 1 and np.median(np.diff(o.time)) < FAST:
        along, moving = o.time, True
    up = upwards(o)
    shown, dotted = (evenly(len(o.frames), most) for most in (MOST_POINTS // 2, MOST_DOTS))
    traces, off = [], []
    for k, s in enumerate(chosen):
        colour, name = MANY[k % len(MANY)], f"{metres(float(f'{s:.3g}'))} from end 0"
        seen, had = _recorded(o, s), _at(o.node_arc, f.x, s)
        off.append(np.linalg.norm(seen - had, axis=1))
        dots = {"color": colour, "size": 5}
        traces += [
            line(along[shown], (had @ up)[shown], name, colour),
            line(
                along[dotted], (seen @ up)[dotted], name, colour,
                mode="markers", marker=dots, showlegend=False,
            ),
        ]  # fmt: skip
        if d is not None and d.causes:
            place = np.flatnonzero(np.isin(o.frames, d.frames))
            height = np.full(len(o.frames), np.nan)
            height[place] = _at(d.node_arc, d.x_after, s) @ up
            traces.append(
                line(
                    along[shown], height[shown], f"{name}, with the cause", colour,
                    line={"dash": "dot", "width": 1.5}, showlegend=False,
                )
            )  # fmt: skip
    rms = np.sqrt(np.nanmean(np.square(off)))
    better = " Dotted: with the cause." if d is not None and d.causes else ""
    return Figure(
        "Height of some markers, recorded and simulated",
        traces,
        plane(
            axis("time (s)" if moving else "frame"),
            axis("height (m)"),
            shapes=bands(_held(o, f, along, moving)),
        ),
        f"Dots: recorded. Lines: simulated, {millimetres(float(rms))} (rms, in space) from them."
        f"{better} Shaded: held out of the fit." + thinned(len(o.frames), MOST_POINTS // 2),
    )


def _held(
    o: Observations, f: FittedModel, along: np.ndarray, moving: bool
) -> list[tuple[float, float]]:
    if not moving:
        return heldout_bands(o.frames, f.heldout)
    return [(float(along[a]), float(along[b])) for a, b in blocks(f.heldout)]


def _recorded(o: Observations, arc: float) -> np.ndarray:
    """Return (F, 3) [m] the marker at an arc length; NaN where it was not seen."""
    out = np.full((len(o.frames), 3), np.nan)
    mine = np.flatnonzero(o.point_arc == arc)
    out[np.searchsorted(o.point_start, mine, side="right") - 1] = o.points[mine]
    return out


def _at(node_arc: np.ndarray, x: np.ndarray, arc: float) -> np.ndarray:
    """Return (F, 3) [m] the rope at an arc length, from its nodes x (F, K, 3)."""
    from scipy.interpolate import CubicSpline

    spline: Any = CubicSpline(node_arc, x, axis=1)
    return spline(arc)
