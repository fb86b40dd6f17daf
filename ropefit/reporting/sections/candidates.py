"""All candidates of the diagnosis: their evidence, by place, and what would have been seen."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import CAUSE, MANY, Figure, axis, line, numbers, plane
from ropefit.reporting.html import heading, pair, paragraph, plot, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import number, ranges, with_unit

ALONG = 6  # places at least: fewer are no places on the rope, but values of a law's own number


class CandidatesSection(Section):
    """The scan of the catalogue, the causes in numbers, and what would have been seen."""

    title = "All candidates"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        places = _places(d)
        figures = pair(_scan(d), places) if places else plot(_scan(d))
        return figures + (_causes(d) if d.causes else Markup("")) + _detectable(d)


def _causes(d: Diagnosis) -> Markup:
    rows = []
    for c in d.causes.values():
        where = "–"
        if c.arc_length is not None:
            where = f"{number(c.arc_length[0])} … {number(c.arc_length[1])} m"
        evidence = f"{number(c.log_evidence, 4)} nats"
        others = ", ".join(name.replace("_", " ") for name in c.equivalent_to)
        name = c.name.replace("_", " ")
        rows.append([name, c.kind, where, ranges(c.frames), evidence, others or "–"])
    head = ["what", "kind", "where", "frames", "evidence", "not ruled out"]
    return heading("Accepted") + table(head, rows)


def _scan(d: Diagnosis) -> Figure:
    best: dict[str, float] = {}
    for c in d.scan.values():
        best[c.name] = max(best.get(c.name, -np.inf), c.log_factor)
    names = sorted(best, key=lambda n: best[n])
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": numbers([best[n] for n in names]),
        "y": names,
        "marker": {"color": CAUSE},
        "name": "log Bayes factor",
    }
    return Figure(
        "Score scan",
        [bars],
        plane(axis("log Bayes factor (nats)"), axis("", names=names), showlegend=False),
        "How much each effect would explain of what the nominal model left, before any was fitted. "
        f"Below {number(d.threshold)} nats it is chance; below zero the data speak against it.",
        height=60 + 17 * len(names),
    )


def _places(d: Diagnosis) -> Figure | None:
    traces = []
    ranked = sorted(d.scan.values(), key=lambda c: -c.log_factor)
    for c in ranked:
        if c.place.shape[1] == 1 and len(c.place) >= ALONG and len(traces) < 4:
            colour = MANY[len(traces) % len(MANY)]
            traces.append(line(c.place[:, 0], c.by_place, c.name, colour))
    if not traces:
        return None
    return Figure(
        "Where on the rope",
        traces,
        plane(axis("arc length s (m)"), axis("log Bayes factor (nats)")),
        "The same for effects at one point, by place.",
    )


def _detectable(d: Diagnosis) -> Markup:
    rows = [
        [name.replace("_", " "), with_unit(number(item.value), item.unit)]
        for name, item in sorted(d.detectable.items())
    ]
    return (
        heading("What this recording would have shown")
        + paragraph("Sizes from which each effect would have been found here, typically.", "note")
        + table(["effect", "size"], rows)
    )
