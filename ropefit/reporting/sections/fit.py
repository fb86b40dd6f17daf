"""The fit in detail: every frame's error, correlations, the loss on its way down, calibration."""

from __future__ import annotations

from html import escape

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Balance, FittedModel, ParameterGroup, Stepped
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    DIVERGING,
    MOST_POINTS,
    NOMINAL,
    WITH_CAUSE,
    Figure,
    axis,
    bands,
    evenly,
    heat,
    line,
    plane,
    thinned,
)
from ropefit.reporting.html import facts, heading, pair, paragraph, plot, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import blocks, number, plural, ranges, symbol, unit_text

READABLE = {"m": (1e3, "mm"), "rad": (180 / np.pi, "°"), "1": (100.0, "%"), "s": (1e3, "ms")}
FAR_OUT = 3.0  # prior sd beyond which a fitted error of the set-up is pointed at


class FitSection(Section):
    """Per frame and per group of frames."""

    title = "The fit in detail"
    folded = True

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None

    def render(self, run: RunContents) -> Markup:
        f = run.fitted
        assert f is not None
        body, loss = plot(_by_frame(run, f)), _loss(f)
        many = len(f.groups) > 1
        for count, group in enumerate(f.groups.values(), start=1):
            body += heading(f"Group {count} of {len(f.groups)}") if many else Markup("")
            body += facts(_facts(group))
            correlation = _correlation(group)
            if many:
                body += plot(correlation) if correlation else Markup("")
            else:
                body += pair(correlation, loss) if correlation else plot(loss)
        body += plot(loss) if many else Markup("")
        found = f.balance or f.stepped
        if found and found.calibration:
            body += _calibration(found, many)
        return body


def _facts(group: ParameterGroup) -> dict[str, object]:
    unit = " m" if group.loss_unit == "m" else ""
    fixed = [name for name in group.parameters if name not in group.free_names]
    held = {"Held fixed": Markup(", ").join(map(symbol, fixed))} if fixed else {}
    return {
        "Frames": ranges(group.frames),
        "Loss" if unit else "χ²": number(group.loss_after) + unit,
        "Evaluations": str(group.evaluations),
        "Search": ("converged: " if group.converged else "not converged: ") + group.stop_reason,
        "Condition number": number(group.condition) if group.condition else "singular",
        **held,
    }


def heldout_bands(frames: np.ndarray, heldout: np.ndarray) -> list[tuple[float, float]]:
    """Return stretches of the frame axis that were held out."""
    return [(float(frames[a]) - 0.5, float(frames[b]) + 0.5) for a, b in blocks(heldout)]


def _by_frame(run: RunContents, f: FittedModel) -> Figure:
    """Return distance of the points from the models; with a cause, of the means along the rope."""
    o, d = run.observations, run.diagnosis
    held = bands(heldout_bands(o.frames, f.heldout))
    text = f"Shaded: {plural(int(f.heldout.sum()), 'frame')} held out of the fit." if held else ""
    if d is not None and d.causes:
        rms = [1e3 * np.sqrt(np.nanmean(m**2, axis=1)) for m in (d.misfit_before, d.misfit_after)]
        names = (("nominal", NOMINAL), ("with the cause", WITH_CAUSE))
        traces = [line(d.frames, y, *name) for y, name in zip(rms, names, strict=True)]
        what = "The maps above, one number a frame: rms of the mean offsets along the rope."
        shapes = []
    else:
        shown = evenly(len(o.frames), MOST_POINTS)
        traces = [line(o.frames[shown], 1e3 * f.rms[shown], "nominal", NOMINAL)]
        what = f"Distance of the observed points from the simulated rope. {text}"
        what, shapes = what + thinned(len(o.frames), MOST_POINTS), held
    return Figure(
        "Error in every frame",
        traces,
        plane(axis("frame"), axis("rms distance (mm)", rangemode="tozero"), shapes=shapes),
        what,
        height=240,
    )


def _correlation(group: ParameterGroup) -> Figure | None:
    names = group.free_names
    if len(names) < 2 or not np.isfinite(group.correlation).any():
        return None
    labels = [str(symbol(name)) if name.startswith("eta") else escape(name) for name in names]
    place = list(range(len(names)))
    colours = heat(place, place, group.correlation, "")
    colours |= {"colorscale": DIVERGING, "zmin": -1, "zmax": 1, "numbered": len(names) <= 8}
    ticks = {"tickvals": place, "ticktext": labels}
    layout = plane(axis("", **ticks), axis("", **ticks, reversed=True))
    return Figure(
        "Correlation of the parameters",
        [colours],
        layout,
        "Correlation of the estimates (no unit). Near ±1 two parameters do the same to these "
        "data; blank: not determined.",
    )


def _loss(f: FittedModel) -> Figure:
    step = np.arange(len(f.trace))
    squares = next(iter(f.groups.values())).loss_unit == "chi-square"
    wide = f.trace.min() > 0 and f.trace.max() > 3 * f.trace.min()
    scale = {"type": "log"} if wide else {}
    y = axis("χ²" if squares else "loss (m)", **scale)
    text = f"{f.loss} on its way down ({f.search} search), summed over the frames of the fit."
    if squares:
        text = (
            "Squared residuals over their noise and squared calibration errors over their priors, "
            "summed, in the last fit." + (" First group." if len(f.groups) > 1 else "")
        )
    return Figure(
        "Loss during the search",
        [line(step, f.trace, "loss", NOMINAL, mode="lines+markers", marker={"size": 4})],
        plane(axis("step of the search"), y),
        text,
    )


def _calibration(b: Balance | Stepped, many: bool) -> Markup:
    """Return the errors of the set-up that were fitted along with the rope."""
    rows = []
    for name, item in b.calibration.items():
        factor, unit = READABLE.get(item.unit, (1.0, unit_text(item.unit)))
        sizes = [number(factor * v, 2) for v in (item.prior, item.value, item.sd)]
        off = abs(item.value) > FAR_OUT * item.prior
        flag = Markup('<br><span class="verdict warn">far outside</span>') if off else ""
        label = name.replace("_", " ") + (f" ({unit})" if unit else "")
        rows.append([Markup("{}{}").format(label, flag), *sizes])
    head = ["error of the set-up", "prior ±", "fitted", "± sd"]
    return (
        heading("Calibration" + (", first group" if many else ""))
        + paragraph(
            "Camera, gravity and ends are measured too. Their errors were fitted along with the "
            "rope, held to what is usual for such a set-up (prior, one standard deviation); the "
            "intervals above include them.",
            "note",
        )
        + table(head, rows, (1, 2, 3))
    )
