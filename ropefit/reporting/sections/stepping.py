"""Was every step of a rope in motion solved, and which frames were stepped at all?"""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import axis, by_frame
from ropefit.reporting.html import facts, paragraph, plot
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import metres_or_less
from ropefit.reporting.words import plural, ranges


class SteppingSection(Section):
    """Clips, Newton iterations of every step, frames that belong to no clip."""

    title = "Solver"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None and run.fitted.stepped is not None

    def render(self, run: RunContents) -> Markup:
        f, frames = run.fitted, run.observations.frames
        assert f is not None
        assert f.stepped is not None
        s, left = f.stepped, f.stepped.clip < 0
        text = (
            f"The rope was stepped through {plural(s.clips, 'clip')}, each from its first two "
            "frames on without another look at the recording; every step was solved."
        )
        if left.any():
            text += (
                f" {plural(int(left.sum()), 'frame')} ({ranges(frames[left])}) "
                f"{'belongs' if left.sum() == 1 else 'belong'} to no clip that is long enough: "
                "shown as recorded, and no prediction."
            )
        steps = s.newton[~left]
        numbers = {
            "Solver": "dynamics (BDF2, Newton)",
            "Segments": str(s.segments),
            "Clips": str(s.clips),
            "Newton iterations a step": f"{int(np.median(steps))} (median), {int(steps.max())} most"
            if steps.size
            else "–",
            "Bending length (EI/w)^⅓": metres_or_less(s.bending_length),
        }
        figure = by_frame(
            "Newton iterations of every step",
            frames,
            s.newton,
            "iterations",
            axis("Newton iterations", rangemode="tozero"),
            "What each step took to be solved.",
        )
        return paragraph(text) + facts(numbers) + plot(figure)
