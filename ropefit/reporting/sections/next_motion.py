"""What to do next: the motion that would tell the remaining explanations apart, drawn."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.reporting.camera import broadside
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import CAUSE, WITH_CAUSE, Figure, at, path, space
from ropefit.reporting.html import paragraph, plot
from ropefit.reporting.missing import forced
from ropefit.reporting.next_step import next_step
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.rope import smooth


class NextMotionSection(Section):
    """A sentence, and the rope in the motion as both explanations predict it."""

    title = "What to do next"

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        text = paragraph(next_step(d) or _nothing(d))
        return text if d.motion_x is None else text + plot(_figure(run, d, d.motion_x))


def _nothing(d: Diagnosis) -> str:
    if d.verdict == "unknown":
        where = "the picture has its arrows" if forced(d) else "the map has its boxes"
        return (
            f"Look at the rope where {where}, and record it again with a motion that brings that "
            "place into other shapes."
        )
    return "No two explanations remain to be distinguished, so no further motion is asked for."


def _figure(run: RunContents, d: Diagnosis, x: np.ndarray) -> Figure:
    first, second = (smooth(d.node_arc, shapes) for shapes in x)
    cloud = np.concatenate([first, second]).reshape(-1, 3)
    gap = np.full((1, 3), np.nan)
    names = [name.replace("_", " ") for name in d.separates]
    traces = []
    for name, colour, shapes, dash in (
        (names[0], WITH_CAUSE, first, ""),
        (names[1], CAUSE, second, "dash"),
    ):
        trace = path(name, colour, 2.5) | at(np.concatenate([p for s in shapes for p in (s, gap)]))
        trace["line"] |= {"dash": dash} if dash else {}
        traces.append(trace)
    ways = [path("way of the ends", "ink", 1.5) | at(_ways(first))]
    eye, up = broadside(run.observations, cloud)
    return Figure(
        "The motion that separates the explanations best",
        [*traces, *ways],
        space(cloud.min(axis=0), cloud.max(axis=0), eye, up),
        f"{len(first)} poses of the motion: {d.motion.split(':')[0]}.",
        height=320,
    )


def _ways(x: np.ndarray) -> np.ndarray:
    """Return (P, 3) the ways that both ends go."""
    return np.concatenate([x[:, 0], np.full((1, 3), np.nan), x[:, -1]])
