"""Is every frame in equilibrium, is it stable, and is it the only one?"""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Balance, Stepped
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import Figure, axis, by_frame
from ropefit.reporting.html import facts, pair, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import metres, millimetres, number, plural, ranges


class EquilibriumSection(Section):
    """Newton iterations, residual and stability of every frame; frames with a second state."""

    title = "Solver"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None and run.fitted.balance is not None

    def render(self, run: RunContents) -> Markup:
        f = run.fitted
        assert f is not None
        assert f.balance is not None
        b, frames = f.balance, run.observations.frames
        arrived = b.residual[b.converged]
        numbers = {
            "Solver": "equilibrium (Newton)",
            "Segments": str(b.segments),
            "Frames in equilibrium": f"{int(b.converged.sum())} of {len(frames)}",
            "Newton iterations": f"{int(np.median(b.newton))} (median), {int(b.newton.max())} most",
            "Largest residual": number(float(arrived.max())) if arrived.size else "–",
            "Bending length (EI/w)^⅓": metres_or_less(b.bending_length),
        }
        if b.correlated_noise > 0:
            numbers["Noise correlated along the rope"] = (
                f"{millimetres(b.correlated_noise)} over {millimetres(b.correlation_length)}"
            )
        return (
            paragraph(_verdict(b, frames))
            + facts(numbers)
            + pair(_stability(b, frames), _effort(b, frames))
        )


def metres_or_less(value: float) -> str:
    """Return a length that was found, to three digits."""
    return metres(float(f"{value:.3g}"))


def _verdict(b: Balance, frames: np.ndarray) -> str:
    if b.converged.all():
        text = "Every frame is in a stable equilibrium: the shape does not depend on iterations."
    else:
        lost = ~b.converged
        text = (
            f"{plural(int(lost.sum()), 'frame')} of {len(frames)} reached no equilibrium "
            f"({ranges(frames[lost])}): the rope shown there is where it set out, and says nothing."
        )
    twice = np.isfinite(b.other)
    if not twice.any():
        return text + " No frame was found to have a second one."
    return (
        f"{text} In {plural(int(twice.sum()), 'frame')} ({ranges(frames[twice])}) a second stable "
        f"equilibrium exists under the same conditions, up to {millimetres(np.nanmax(b.other))} "
        "away: a real rope may jump there."
    )


def _stability(b: Balance, frames: np.ndarray) -> Figure:
    known = b.stability[np.isfinite(b.stability)]
    wide = known.size > 0 and known.min() > 0 and known.max() > 30 * known.min()
    scale = {"type": "log"} if wide else {"rangemode": "tozero"}
    return by_frame(
        "Stability in every frame",
        frames,
        1e3 * b.stability,
        "smallest eigenvalue",
        axis("smallest eigenvalue (mN)", **scale),
        "Smallest stiffness of the rope against turning its segments, per length. Positive: "
        "stable; near zero: about to jump.",
        (np.isfinite(b.other), "has a second equilibrium", "diamond-open"),
    )


def _effort(b: Balance, frames: np.ndarray) -> Figure:
    return by_frame(
        "Newton iterations in every frame",
        frames,
        b.newton,
        "iterations",
        axis("Newton iterations", rangemode="tozero"),
        "From the state that the fit left behind to the one shown.",
        (~b.converged, "not converged", "x"),
        mode="lines+markers",
    )


def mass_note(b: Balance | Stepped) -> str:
    """Return what shapes alone can tell."""
    return (
        "The rope’s mass is not known: shapes alone fix only ratios to its weight, so rigidities "
        "are given over the weight per length w (EI/w in m³). The bending length (EI/w)^⅓ is "
        f"{metres_or_less(b.bending_length)}."
    )
