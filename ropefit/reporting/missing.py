"""What is missing, as traces of the picture: causes by their symbols, and a latent force."""

from __future__ import annotations

from typing import Any

import numpy as np

from ropefit.artifacts import Diagnosis, Observations
from ropefit.reporting.camera import upwards
from ropefit.reporting.figures import CAUSE, path
from ropefit.reporting.glyphs import Place, arrow, band, drawn_of, label_of, strokes

LONGEST = 0.15  # of the rope's length: the longest arrow of force
BAND = (3.0, 10.0, 20.0)  # px: how wide the stretch is drawn, least, usual, most
FAINT, CLEAR = 0.4, 0.55  # opacity of a stretch beside a symbol, and of one that is the symbol

Traces = list[tuple[dict[str, Any], list[np.ndarray]]]


def forced(d: Diagnosis) -> bool:
    """Return whether the latent force is more than chance."""
    return d.verdict != "none" and d.force_evidence > d.force_threshold


def missing(
    d: Diagnosis, o: Observations, rows: np.ndarray, arc: np.ndarray, x: np.ndarray,
    side: np.ndarray,
) -> Traces:  # fmt: skip
    """Return traces, each with its points in every step, on ropes x (N, P, 3) at arc (P,): those of
    the diagnosis's frames `rows` (N,); side (3,): sideways in the view."""
    ends = o.end_position.reshape(-1, 3)
    ends = ends[np.isfinite(ends).all(axis=1)]
    middle = ends.mean(axis=0) if len(ends) else x.reshape(-1, 3).mean(axis=0)
    out: Traces = []
    for cause in d.causes.values():
        drawn = drawn_of(cause, o.gravity)
        stretch = cause.arc_length or (0.0, float(arc[-1]))
        places = [Place(rope, arc, stretch, cause.end, middle, upwards(o), side) for rope in x]
        lines, labels = zip(*(strokes(drawn, place) for place in places), strict=True)
        broad = path("", CAUSE, BAND[1])
        broad["line"]["opacity"] = FAINT
        if drawn.symbol == "stretch":  # thicker where the rope is stiffer
            width = float(np.clip(BAND[1] * drawn.size**0.5, BAND[0], BAND[2]))
            broad["line"] |= {"width": width, "opacity": CLEAR}
        text = {"mode": "text", "text": [label_of(cause, drawn)]}
        out.append((broad, [band(place) for place in places]))
        out.append((path(cause.name.replace("_", " "), CAUSE, 2.5), list(lines)))
        out.append((path("", CAUSE, 2, **text), [label[None] for label in labels]))
    if forced(d):
        place = Place(x[0], arc, (0.0, 0.0), None, middle, upwards(o), side)
        arrows = [_forces(d, t, rope, place) for t, rope in zip(rows, x, strict=True)]
        out.append((path("force that would explain what is left", CAUSE, 2.5), arrows))
    return out


def _forces(d: Diagnosis, t: int, x: np.ndarray, place: Place) -> np.ndarray:
    """Return arrows (A, 3) on the rope x (P, 3) in frame t of the diagnosis, where they are beyond
    their standard error."""
    size = np.linalg.norm(d.force, axis=-1)
    scale = LONGEST * float(place.arc[-1]) / max(float(size.max()), 1e-300)
    sure = size[t] > np.linalg.norm(d.force_sd[t], axis=-1)
    gap = np.full((1, 3), np.nan)
    parts = [gap]
    for s, force in zip(d.force_arc[sure], d.force[t][sure], strict=True):
        foot = np.array([np.interp(s, place.arc, axis) for axis in x.T])
        parts += [arrow(foot, scale * force, place), gap]
    return np.concatenate(parts)
