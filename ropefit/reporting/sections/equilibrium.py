"""Is every frame in equilibrium, is it stable, and is it the only one?"""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Balance, Stepped
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    MOST_POINTS,
    NOMINAL,
    Figure,
    axis,
    evenly,
    line,
    plane,
    thinned,
)
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
    """A length that was found, to three digits."""
    return metres(float(f"{value:.3g}"))


def _verdict(b: Balance, frames: np.ndarray) -> str:
    if b.converged.all():
        told = "Every frame is in a stable equilibrium: the shape does not depend on iterations."
    else:
        lost = ~b.converged
        told = (
            f"{plural(int(lost.sum()), 'frame')} of {len(frames)} reached no equilibrium "
            f"({ranges(frames[lost])}): the rope shown there is where it set out, and says nothing."
        )
    twice = np.isfinite(b.other)
    if not twice.any():
        return told + " No frame was found to have a second one."
    return (
        f"{told} In {plural(int(twice.sum()), 'frame')} ({ranges(frames[twice])}) a second stable "
        f"equilibrium exists under the same conditions, up to {millimetres(np.nanmax(b.other))} "
        "away: a real rope may jump there."
    )


def _stability(b: Balance, frames: np.ndarray) -> Figure:
    shown = evenly(len(frames), MOST_POINTS)
    values = b.stability[shown]
    traces = [line(frames[shown], 1e3 * values, "smallest eigenvalue", NOMINAL)]
    twice = np.isfinite(b.other[shown])
    if twice.any():
        marks = {"color": "soft", "symbol": "diamond-open", "size": 9}
        traces.append(
            line(
                frames[shown][twice], 1e3 * values[twice], "has a second equilibrium", "soft",
                mode="markers", marker=marks,
            )
        )  # fmt: skip
    known = values[np.isfinite(values) & (values > 0)]
    wide = known.size > 0 and known.max() > 30 * known.min() and (values[~np.isnan(values)] > 0)
    scale = {"type": "log"} if np.all(wide) else {"rangemode": "tozero"}
    return Figure(
        "Stability in every frame",
        traces,
        plane(axis("frame"), axis("smallest eigenvalue (mN)", **scale)),
        "Smallest stiffness of the rope against turning its segments, per length. Positive: "
        "stable; near zero: about to jump." + thinned(len(frames), MOST_POINTS),
    )


def _effort(b: Balance, frames: np.ndarray) -> Figure:
    shown = evenly(len(frames), MOST_POINTS)
    traces = [line(frames[shown], b.newton[shown], "iterations", NOMINAL, mode="lines+markers")]
    lost = ~b.converged[shown]
    if lost.any():
        marks = {"color": "soft", "symbol": "x", "size": 9}
        traces.append(
            line(
                frames[shown][lost], b.newton[shown][lost], "not converged", "soft",
                mode="markers", marker=marks,
            )
        )  # fmt: skip
    return Figure(
        "Newton iterations in every frame",
        traces,
        plane(axis("frame"), axis("Newton iterations", rangemode="tozero")),
        "From the state that the fit left behind to the one shown."
        + thinned(len(frames), MOST_POINTS),
    )


def mass_note(b: Balance | Stepped) -> str:
    """What shapes alone can tell."""
    return (
        "The rope’s mass is not known: shapes alone fix only ratios to its weight, so rigidities "
        "are given over the weight per length w (EI/w in m³). The bending length (EI/w)^⅓ is "
        f"{metres_or_less(b.bending_length)}."
    )
