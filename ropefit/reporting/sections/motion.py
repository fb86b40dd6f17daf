"""What to record next: the motion that would tell the remaining explanations apart."""

from __future__ import annotations

from markupsafe import Markup

from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import listed


class MotionSection(Section):
    """One sentence."""

    title = "Next motion"

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        if d.motion:
            return paragraph(
                Markup("To tell {} apart, {}.").format(
                    listed(name.replace("_", " ") for name in d.separates), d.motion
                )
            )
        if any(c.equivalent_to for c in d.causes.values()):
            return paragraph(
                "The explanations that fit equally well would stay equal under every motion tried: "
                "only another measurement (a plumb line, a weighing, a wrist force) can decide."
            )
        return paragraph(
            "No two explanations are left to be told apart, so no further motion is asked for."
        )
