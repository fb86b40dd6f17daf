"""What preprocess made of the recording, and which frames it excluded."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Observations
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    MOST_COLUMNS,
    MOST_POINTS,
    RECORDED,
    Figure,
    axis,
    evenly,
    heat,
    line,
    plane,
    thinned,
)
from ropefit.reporting.html import facts, heading, loose, pair, paragraph, plot, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import given, metres, millimetres, number, percent, ranges

MOST_REASONS = 30


class ObservationsSection(Section):
    """Frames used and dropped, what was seen of the rope, noise, plane, ends and length."""

    title = "Observations"
    folded = True

    def render(self, run: RunContents) -> Markup:
        o = run.observations
        body = facts(_facts(o)) + paragraph(_projection(o))
        figures = [_visibility(o)]
        if np.ptp(o.noise) > 0:
            figures.append(_noise(o))
        body += pair(*figures) if len(figures) > 1 else plot(figures[0])
        return body + _dropped(o)


def _facts(o: Observations) -> dict[str, object]:
    known = o.length_source == "recording"
    source = "given by the recording" if known else f"{o.length_source} from the frames"
    ends = f"end 0 (gripper) {o.end_kind[0]}, end 1 {o.end_kind[1]}"
    dropped = f"{len(o.dropped)} dropped"
    return {
        "Source": o.source + ("" if o.depth_measured else ", without depth"),
        "Frames": f"{len(o.frames)} used, {dropped}",
        "Points": f"{len(o.points)}, {number(len(o.points) / len(o.frames))} per frame",
        "Rope seen": percent(float(o.visibility.mean()), 3),
        "Length": f"{metres(o.length)}, {source}",
        "Diameter": given(1e3 * o.diameter, "mm") if o.diameter else "not given",
        "Mass": given(1e3 * o.mass, "g") if o.mass else "not given",
        "Ends": ends + (" (assumed)" if o.ends_assumed else ""),
        "Noise from": o.noise_source,
        **_shared_noise(o),
        "Gravity": "[" + ", ".join(given(v) for v in o.gravity) + "] m/s²",
    }


def _shared_noise(o: Observations) -> dict[str, object]:
    """Return what is known of the noise along the rope, of the length and of the frames'
    quality."""
    out: dict[str, object] = {}
    if o.noise_correlated is not None and o.noise_length is not None and o.noise_white is not None:
        white = o.noise_white[np.isfinite(o.noise_white)]
        own = f"{millimetres(float(np.median(white)))} each point's own, " if white.size else ""
        shared = f"{millimetres(o.noise_correlated)} shared over {millimetres(o.noise_length)}"
        out["Noise along the rope"] = own + (shared if o.noise_correlated > 0 else "none shared")
    if o.length_sd is not None:
        out["Spread of the length"] = f"{millimetres(o.length_sd)} over frames, as traced"
    if o.quality is not None:
        worst = int(np.argmin(o.quality))
        out["Quality"] = (
            f"{number(float(np.median(o.quality)))} of 1, least {number(float(o.quality[worst]))} "
            f"in frame {o.frames[worst]}"
        )
    return out


def _projection(o: Observations) -> str:
    why = o.projection_reason.removesuffix(": projected").replace(": kept in 3D, ", "; ")
    if o.projected:
        return f"Projected onto the plane of gravity and the two ends: {why}."
    return f"Kept in 3D: {why}."


def _visibility(o: Observations) -> Figure:
    shown = evenly(len(o.frames), MOST_COLUMNS)
    middle = (o.node_arc[1:] + o.node_arc[:-1]) / 2
    seen = np.where(o.seen[shown], 1.0, np.nan).T
    colours = heat(o.frames[shown], middle, seen, "") | {
        "colorscale": [[0, RECORDED], [1, RECORDED]],
        "showscale": False,
        "zmin": 0,
        "zmax": 1,
    }
    return Figure(
        "Segments of the rope that are seen, over frames",
        [colours],
        plane(axis("frame"), axis("arc length s (m)")),
        "Grey: this segment of the rope was seen. Blank: hidden or missing."
        + thinned(len(o.frames), MOST_COLUMNS),
    )


def _noise(o: Observations) -> Figure:
    shown = evenly(len(o.frames), MOST_POINTS)
    return Figure(
        "Noise of a point in every frame",
        [line(o.frames[shown], 1e3 * o.noise[shown], "noise", RECORDED)],
        plane(axis("frame"), axis("noise (mm)", rangemode="tozero")),
        "Standard deviation of a point about the rope’s centreline."
        + thinned(len(o.frames), MOST_POINTS),
    )


def _dropped(o: Observations) -> Markup:
    """Return excluded frames, gathered by reason."""
    by_reason: dict[str, list[int]] = {}
    for item in o.dropped:
        by_reason.setdefault(item.reason, []).append(item.frame)
    if not by_reason:
        return Markup("")
    rows = [(len(frames), ranges(frames), loose(reason)) for reason, frames in by_reason.items()]
    rows.sort(key=lambda row: -row[0])
    body = heading("Excluded frames") + table(["count", "frames", "reason"], rows[:MOST_REASONS])
    if len(rows) > MOST_REASONS:
        body += paragraph(f"{len(rows) - MOST_REASONS} rarer reasons are not listed.", "note")
    return body
