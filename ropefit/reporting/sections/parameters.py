"""The identified numbers, each with its interval and with what the data say about it."""

from __future__ import annotations

from html import escape

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Balance, FittedModel, Parameter, ParameterGroup, Stepped
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import AFTER, DIVERGING, Figure, axis, heat, line, plane
from ropefit.reporting.html import facts, heading, pair, paragraph, plot, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import mass_note
from ropefit.reporting.words import (
    digits_of,
    given,
    listed,
    number,
    ranges,
    symbol,
    unit_text,
    with_unit,
)

VERDICTS = {
    "determined": "the data fix the value to within its interval",
    "trade-off": "only a combination with the parameters named is fixed",
    "flat direction": "a wide range of values fits as well",
    "dead": "the value makes no difference to these data",
    "at bound": "the search ended at the edge of its range",
    "fixed": "was not fitted",
}
READABLE = {"m": (1e3, "mm"), "rad": (180 / np.pi, "°"), "1": (100.0, "%"), "s": (1e3, "ms")}
FAR_OUT = 3.0  # prior sd beyond which a fitted error of the set-up is pointed at
SHOW_VALUES = {"texttemplate": "%{z:.2f}", "textfont": {"color": "ink"}, "hoverinfo": "skip"}


class ParametersSection(Section):
    """Per group a table and the correlations; calibration errors; the loss on its way down."""

    title = "Parameters"

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None

    def render(self, run: RunContents) -> Markup:
        f = run.fitted
        assert f is not None
        body, loss = Markup(""), _loss(f)
        if f.iterated and not f.solver_converged:
            body += paragraph(
                "The solver has not converged: these values belong to "
                f"{f.iterated.steps} × {f.iterated.iterations} iterations and would differ at "
                "another count. The intervals do not include that."
            )
        found = f.balance or f.stepped
        if found and not found.mass_known:
            body += paragraph(mass_note(found))
        many = len(f.groups) > 1
        for count, group in enumerate(f.groups.values(), start=1):
            body += _group(group, f"Group {count} of {len(f.groups)}" if many else "")
            correlation = _correlation(group)
            if many:
                body += plot(correlation) if correlation else Markup("")
            else:
                body += pair(correlation, loss) if correlation else plot(loss)
        body += plot(loss) if many else Markup("")
        if found and found.calibration:
            body += _calibration(found, many)
        return body


def _group(group: ParameterGroup, name: str) -> Markup:
    ordered = _in_order(group)
    rows = [_row(key, p) for key, p in ordered]
    head = ["parameter", "before", "after", "95 % interval", "verdict", "trades with", "meaning"]
    if not any(p.trades_with for _, p in ordered):
        rows, head = [row[:5] + row[6:] for row in rows], head[:5] + head[6:]
    unit = " m" if group.loss_unit == "m" else ""
    before, after = number(group.loss_before), number(group.loss_after) + unit
    used = {p.verdict for _, p in ordered}
    told = ". ".join(f"{k.capitalize()}: {v}" for k, v in VERDICTS.items() if k in used) + "."
    numbers = {
        "Frames": ranges(group.frames),
        f"{'Loss' if unit else 'χ²'}, before → after": f"{before} → {after}",
        "Evaluations": str(group.evaluations),
        "Search": ("converged: " if group.converged else "not converged: ") + group.stop_reason,
        "Condition number": number(group.condition) if group.condition else "singular",
    }
    return (
        (heading(name) if name else Markup(""))
        + table(head, rows, (1, 2, 3))
        + paragraph(told, "note")
        + facts(numbers)
    )


def _in_order(group: ParameterGroup) -> list[tuple[str, Parameter]]:
    """The free ones in the order of the correlation matrix, then the fixed ones."""
    rest = [name for name in group.parameters if name not in group.free_names]
    return [(name, group.parameters[name]) for name in [*group.free_names, *rest]]


def _row(name: str, p: Parameter) -> list[object]:
    digits = digits_of(p.ci95)
    interval = "none" if p.free else "–"
    if p.ci95 is not None:
        low, high = (number(value, digits) for value in p.ci95)
        interval = with_unit(f"{low} … {high}", p.unit)
    elif p.below is not None:
        interval = with_unit(f"below {number(p.below)}", p.unit)
    kind = {"determined": "good", "fixed": ""}.get(p.verdict, "warn")
    return [
        Markup('<span title="{}">{}</span>').format(name, symbol(name)),
        with_unit(given(p.initial) if abs(p.initial) >= 1e-3 else number(p.initial), p.unit),
        with_unit(number(p.value, digits), p.unit),
        interval,
        Markup('<span class="verdict {}">{}</span>').format(kind, p.verdict),
        listed(map(symbol, p.trades_with)),
        p.meaning,
    ]


def _correlation(group: ParameterGroup) -> Figure | None:
    names = group.free_names
    if len(names) < 2 or not np.isfinite(group.correlation).any():
        return None
    labels = [str(symbol(name)) if name.startswith("eta") else escape(name) for name in names]
    place = list(range(len(names)))
    colours = heat(place, place, group.correlation, "")
    colours |= {"colorscale": DIVERGING, "zmin": -1, "zmax": 1, "xgap": 1, "ygap": 1}
    colours |= SHOW_VALUES if len(names) <= 8 else {}
    ticks = {"tickmode": "array", "tickvals": place, "ticktext": labels}
    bare = {"showline": False, "showgrid": False, "ticks": "", "constrain": "domain"}
    layout = plane(
        axis("", **ticks | bare),
        axis("", **ticks | bare, autorange="reversed", scaleanchor="x"),
    )
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
    told = f"{f.loss} on its way down ({f.search} search), summed over the frames of the fit."
    if squares:
        told = (
            "Squared residuals over their noise and squared calibration errors over their priors, "
            "summed, in the last fit." + (" First group." if len(f.groups) > 1 else "")
        )
    return Figure(
        "Loss during the search",
        [line(step, f.trace, "loss", AFTER, mode="lines+markers", marker={"size": 4})],
        plane(axis("step of the search"), y),
        told,
    )


def _calibration(b: Balance | Stepped, many: bool) -> Markup:
    """The errors of the set-up that were fitted along with the rope."""
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
