"""Did a solver of the paper arrive? Whatever it did not finish is no property of the rope."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import FittedModel, Iterated
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import NOMINAL, Figure, axis, by_frame, line, plane
from ropefit.reporting.html import facts, pair, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import given, millimetres, number, percent


class SolverSection(Section):
    """Distance constraint and rope length along the iterations, and per frame at the end."""

    title = "Solver"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None and run.fitted.iterated is not None

    def render(self, run: RunContents) -> Markup:
        f = run.fitted
        assert f is not None
        assert f.iterated is not None
        it = f.iterated
        length, frames = run.observations.length, run.observations.frames
        final = it.length_error[:, -1]
        settings = {
            "Solver": f.solver,
            "Iterations": f"{it.steps} steps × {it.iterations}",
            "Time step": given(it.dt, "s"),
            Markup("Largest |C<sup>D</sup>| at the end"): millimetres(
                float(it.distance_violation[:, -1].max())
            ),
            "Largest error of length": percent(float(np.abs(final).max())),
        }
        return (
            paragraph(_verdict(f, it, length))
            + facts(settings)
            + pair(_violation(it), _length(it))
            + pair(_drift(it, frames), _length_by_frame(it, frames))
        )


def _verdict(f: FittedModel, it: Iterated, length: float) -> str:
    total = it.steps * it.iterations
    drift = float(np.median(it.drift))
    text = (
        f"with {2 * total} iterations instead of {total} the rope would move by {percent(drift)} "
        f"of its length in the median frame ({millimetres(drift * length)}) and by "
        f"{percent(float(it.drift.max()))} in the worst"
    )
    if f.solver_converged:
        return f"Converged: {text}."
    against = drift * length / f.rms_fit if f.rms_fit > 0 else np.inf
    rest = ""
    if against > 1:
        rest = f" That is {number(against, 2)} times what is left between simulation and recording."
    return (
        f"Not converged: {text}.{rest} The parameters make up for the iterations that are missing: "
        "they hold for this count only and are not properties of the rope."
    )


def _violation(it: Iterated) -> Figure:
    middle, worst = np.median(it.distance_violation, axis=0), it.distance_violation.max(axis=0)
    return Figure(
        "Largest distance constraint over the iterations",
        [
            line(it.iteration, 1e3 * middle, "median frame", NOMINAL),
            line(it.iteration, 1e3 * worst, "worst frame", "soft"),
        ],
        plane(
            axis("iteration", type="log", dtick=1),
            axis("max |C<sup>D</sup>| (mm)", rangemode="tozero"),
        ),
        "How far the worst-stretched segment is from its rest length.",
    )


def _length(it: Iterated) -> Figure:
    last = int(np.argmax(np.abs(it.length_error[:, -1])))
    return Figure(
        "Relative rope length over the iterations",
        [
            line(it.iteration, 100 * np.median(it.length_error, axis=0), "median frame", NOMINAL),
            line(it.iteration, 100 * it.length_error[last], "worst frame", "soft"),
        ],
        plane(axis("iteration", type="log", dtick=1), axis("length beyond rest length (%)")),
        "Rope length against rest length. Worst: the frame farthest off at the end.",
    )


def _drift(it: Iterated, frames: np.ndarray) -> Figure:
    return by_frame(
        "Move of the rope if iterated twice as long, in every frame",
        frames,
        100 * it.drift,
        "drift",
        axis("drift (% of length)", rangemode="tozero"),
        "Largest move of any particle if iterated twice as long.",
    )


def _length_by_frame(it: Iterated, frames: np.ndarray) -> Figure:
    return by_frame(
        "Error of the rope length in every frame",
        frames,
        100 * it.length_error[:, -1],
        "error of length",
        axis("length beyond rest length (%)"),
        "Error of the simulated rope’s length at the last iteration.",
    )
