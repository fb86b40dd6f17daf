"""The law that was found: its curve with a band, where the data visit it, and its form."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts.causes import Law
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import CAUSE, Figure, axis, bands, line, plane
from ropefit.reporting.html import paragraph, plot
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import number


class LawSection(Section):
    """A figure for each law with a curve among the causes."""

    title = "The law"

    def applies(self, run: RunContents) -> bool:
        return bool(_laws(run))

    def render(self, run: RunContents) -> Markup:
        laws = _laws(run)
        return Markup("").join(paragraph(_sentence(law)) + plot(_figure(law)) for law in laws)


def _laws(run: RunContents) -> list[Law]:
    """Return the laws with a curve: of the diagnosis, or else those that were asked for."""
    found = run.diagnosis.causes if run.diagnosis else {}
    asked = run.model.nominal.laws if run.model else {}
    every = [[c.law for c in own.values() if c.law and c.law.curve] for own in (found, asked)]
    return every[0] or every[1]


def _sentence(law: Law) -> str:
    if law.form:
        return f"{law.form} explains the data as well as the free curve; no other form does."
    if law.forms:
        return f"Forms that explain the data about equally: {'; '.join(law.forms)}."
    return "None of the forms that were tried explains the data as well as this curve."


def _figure(law: Law) -> Figure:
    c = law.curve
    assert c is not None
    low, high = c.visited
    inside = (c.x >= low) & (c.x <= high)
    outside = [(float(c.x[0]), low), (high, float(c.x[-1]))]
    edge = {"line": {"width": 1.2, "dash": "dash"}, "showlegend": False}
    return Figure(
        f"{c.name_y} over {c.name_x}",
        [
            line(c.x, np.where(inside, c.y, np.nan), c.name_y, CAUSE),
            line(c.x, np.where(inside, np.nan, c.y), "beyond the data", "soft"),
            line(c.x, c.low, "95 % band", "soft", **edge),
            line(c.x, c.high, "", "soft", **edge),
        ],
        plane(
            axis(f"{c.name_x} ({c.unit_x})"), axis(f"{c.name_y} ({c.unit_y})"),
            shapes=bands(outside),
        ),
        f"Dashed: the 95 % band. Shaded: values of the {c.name_x} that the data hardly visit (they "
        f"lie between {number(low)} and {number(high)} {c.unit_x}).",
    )  # fmt: skip
