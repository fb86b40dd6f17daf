"""Latent force as arrows on the rope: what would have to pull there to explain what is left."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import AFTER, BEFORE, MARK, Figure, evenly, places, space, thinned
from ropefit.reporting.html import sequence
from ropefit.reporting.sections.overlay import from_camera
from ropefit.reporting.words import number

MOST_FRAMES = 40
LONGEST = 0.2  # of the rope's length: the longest arrow
HEAD, SPREAD = 0.3, 0.12  # of an arrow: its head
CERTAIN = 2.0  # standard deviations from which an arrow is drawn in full colour


def forces(run: RunContents, d: Diagnosis) -> Markup:
    """The rope with arrows, by a slider over the frames of the diagnosis."""
    shown = evenly(len(d.frames), MOST_FRAMES)
    return sequence([_figure(run, d, shown)], [f"Frame {d.frames[t]}" for t in shown])


def _figure(run: RunContents, d: Diagnosis, shown: np.ndarray) -> Figure:
    size = np.linalg.norm(d.force, axis=-1)
    top = float(size.max())
    scale = LONGEST * float(d.node_arc[-1]) / max(top, 1e-300)
    sure = size > CERTAIN * np.linalg.norm(d.force_sd, axis=-1)
    steps, everything = [], []
    for t in shown:
        base = np.stack([np.interp(d.force_arc, d.node_arc, x) for x in d.x_after[t].T], axis=-1)
        arrows = scale * d.force[t]
        parts = [
            d.x_after[t],
            _strokes(base[~sure[t]], arrows[~sure[t]]),
            _strokes(base[sure[t]], arrows[sure[t]]),
        ]
        everything += [d.x_after[t], base + arrows]
        steps.append([dict(zip("xyz", map(places, part.T), strict=True)) for part in parts])
    cloud = np.concatenate(everything)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    eye, up = from_camera(run.observations, (low + high) / 2)
    traces = [
        {"type": "scatter3d", "mode": "lines", "hoverinfo": "skip", "name": name}
        | {"line": {"color": colour, "width": width}}
        for name, colour, width in (
            ("rope", AFTER, 4),
            ("force within its error", BEFORE, 2),
            ("force beyond two standard deviations", MARK, 4),
        )
    ]
    return Figure(
        "Latent force along the rope",
        traces,
        space(low, high, eye, up),
        "Arrows: the smooth force per length that would explain what the model with its causes "
        f"still leaves; the longest is {number(top)} N/m. Evidence {number(d.force_evidence)} "
        f"nats; up to {number(d.force_threshold)} is chance." + thinned(len(d.frames), MOST_FRAMES),
        height=420,
        steps=steps,
    )


def _strokes(base: np.ndarray, arrows: np.ndarray) -> np.ndarray:
    """(6 A, 3) a polyline that draws A arrows (A, 3) from base (A, 3), with gaps of NaN."""
    if len(base) == 0:
        return np.full((1, 3), np.nan)
    side = np.cross(arrows, np.array([0.0, 1.0, 0.0]))
    flat = np.linalg.norm(side, axis=1, keepdims=True)
    length = np.linalg.norm(arrows, axis=1, keepdims=True)
    side = np.where(flat > 1e-12, side / np.maximum(flat, 1e-300), [1.0, 0.0, 0.0]) * length
    tip, neck = base + arrows, base + (1 - HEAD) * arrows
    gap = np.full_like(base, np.nan)
    parts = [base, tip, neck + SPREAD * side, tip, neck - SPREAD * side, gap]
    return np.stack(parts, axis=1).reshape(-1, 3)
