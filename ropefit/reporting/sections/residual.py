"""Where recording and simulation differ: on the rope, over the frames, by what latent force."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import FittedModel, Observations
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    AFTER,
    BEFORE,
    MOST_COLUMNS,
    MOST_POINTS,
    Figure,
    axis,
    bands,
    evenly,
    heat,
    line,
    plane,
    thinned,
)
from ropefit.reporting.html import plot
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.forces import forces
from ropefit.reporting.words import blocks


class ResidualSection(Section):
    """Heat map over arc length and frame, the rms of every frame, latent force arrows."""

    title = "Where it differs"

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None

    def render(self, run: RunContents) -> Markup:
        o, f = run.observations, run.fitted
        assert f is not None
        body = plot(_map(o, f)) + plot(_by_frame(o, f))
        d = run.diagnosis
        if d is not None and d.verdict != "none":
            body += forces(run, d)
        return body


def heldout_bands(frames: np.ndarray, heldout: np.ndarray) -> list[tuple[float, float]]:
    """Stretches of the frame axis that were held out."""
    return [(float(frames[a]) - 0.5, float(frames[b]) + 0.5) for a, b in blocks(heldout)]


def _map(o: Observations, f: FittedModel) -> Figure:
    shown = evenly(len(o.frames), MOST_COLUMNS)
    top = float(np.nanmax(f.residual)) if np.isfinite(f.residual).any() else 0.0
    colours = heat(o.frames[shown], o.node_arc, 1e3 * f.residual[shown].T, "mm")
    colours |= {"zmin": 0, "zmax": max(1e3 * top, 1e-3)}
    colours["hovertemplate"] = "frame %{x}, s = %{y} m: %{z} mm<extra></extra>"
    return Figure(
        "Distance between recording and simulation over arc length and frame",
        [colours],
        plane(axis("frame"), axis("arc length s (m)")),
        "Distance of the observed centreline from the simulated rope after the fit. Blank: not "
        "seen. s = 0 is the gripper’s end." + thinned(len(o.frames), MOST_COLUMNS),
    )


def _by_frame(o: Observations, f: FittedModel) -> Figure:
    shown = evenly(len(o.frames), MOST_POINTS)
    frames = o.frames[shown]
    before, after, noise = (1e3 * a[shown] for a in (f.rms_initial, f.rms, o.noise))
    traces = [
        line(frames, before, "before", BEFORE),
        line(frames, after, "after", AFTER),
        line(frames, noise, "noise", "ink", line={"dash": "dot", "width": 1.5}),
    ]
    wide = max(before.max(), after.max()) > 20 * max(min(after.min(), noise.min()), 1e-9)
    y = axis("rms distance (mm)", **({"type": "log"} if wide else {"rangemode": "tozero"}))
    if f.heldout.any():
        grey = {"color": "soft", "symbol": "square", "size": 11, "opacity": 0.35}
        traces.append(
            {"type": "scatter", "x": [None], "y": [None], "mode": "markers", "marker": grey}
            | {"name": "held out of the fit"}
        )
        told = "Shaded frames were held out: the fit never saw them."
    else:
        told = "No frame was held out."
    edges = [float(frames[0]) - 0.5, float(frames[-1]) + 0.5]
    return Figure(
        "Root mean square distance in every frame, before and after the fit",
        traces,
        plane(axis("frame", range=edges), y, shapes=bands(heldout_bands(o.frames, f.heldout))),
        f"Distance of the observed points from the simulated rope. {told}"
        + thinned(len(o.frames), MOST_POINTS),
    )
