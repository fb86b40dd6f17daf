"""Where the gripper was, or where it must go, and how far that is from the truth or the target."""

from __future__ import annotations

from markupsafe import Markup

from ropefit.artifacts import Control
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import facts, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.control_estimate import estimate
from ropefit.reporting.sections.control_shape import shape
from ropefit.reporting.words import metres, percent, plural


class ControlSection(Section):
    """An estimate frame by frame, or the poses that give wanted shapes."""

    title = "Control"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.control is not None

    def render(self, run: RunContents) -> Markup:
        c = run.control
        assert c is not None
        body = paragraph(_text(c)) + facts(_facts(c))
        body += estimate(run, c) if c.kind == "estimate" else shape(run, c)
        return body + Markup("").join(paragraph(note, "note") for note in c.notes)


def _text(c: Control) -> str:
    if c.kind == "estimate":
        task = "Where was the gripper? Its position is found from the shape of the rope alone"
    else:
        task = (
            "Where must the gripper go? The pose is found that brings the rope to the wanted shape"
        )
    moved = "position and orientation" if c.moves_orientation else "position"
    return f"{task}, by changing its {moved} until the simulated rope agrees."


def _facts(c: Control) -> dict[str, object]:
    nodes = c.x.shape[1]
    arc = c.control_node * c.length / max(nodes - 1, 1)
    noun = "frame" if c.kind == "estimate" else "target"
    return {
        "Converged": f"{int(c.converged.sum())} of {plural(len(c.cases), noun)}",
        "Control point": f"at {metres(arc)} along the rope",
        "Loss": c.loss_name,
        "Solver": c.solver,
        "Largest error of length": percent(float(abs(c.length_error).max())),
    }
