"""Several runs beside each other: do they agree on the rope, which fits better, what differs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from markupsafe import Markup

from ropefit.artifacts import Parameter
from ropefit.reporting.answer import answer
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    NOMINAL,
    RECORDED,
    Figure,
    axis,
    numbers,
    plane,
)
from ropefit.reporting.html import bullets, facts, heading, pair, paragraph, plot, table
from ropefit.reporting.report import Part, render_page
from ropefit.reporting.words import (
    listed,
    metres,
    millimetres,
    number,
    plural,
    symbol,
    unit_text,
    with_unit,
)

Named = tuple[str, RunContents]


def render_comparison(runs: Sequence[Named]) -> str:
    """Return one page on runs (name, contents); the first is what the others are compared with."""
    parts = [
        Part("Comparison", _text(runs) + _overview(runs)),
        Part("Parameters", _parameters(runs)),
        Part("How well they fit", _fits(runs)),
        Part("Each by itself", _answers(runs)),
    ]
    return render_page(f"{len(runs)} runs compared", parts)


def _text(runs: Sequence[Named]) -> Markup:
    """Return what agrees and what does not, in sentences."""
    sentences: list[object] = []
    for key, values in _values(runs).items():
        pairs = [
            (a, b, _disagree(p, q)) for (a, p), (b, q) in itertools.combinations(values.items(), 2)
        ]
        known = [(a, b, apart) for a, b, apart in pairs if apart is not None]
        apart = [f"{a} and {b}" for a, b, differ in known if differ]
        if apart:
            sentences.append(
                Markup("{} differs beyond its 95 % intervals between {}.").format(
                    symbol(key), listed(apart)
                )
            )
        elif known:
            sentences.append(
                Markup("{} agrees within its 95 % intervals in {}.").format(
                    symbol(key), plural(len(known), "pair")
                )
            )
    lengths = {f"{run.observations.length:.3g}" for _, run in runs}
    if len(lengths) > 1:
        sentences.append("The ropes are not equally long: these may be different ropes.")
    return bullets(sentences)


def _overview(runs: Sequence[Named]) -> Markup:
    rows = []
    for name, run in runs:
        o, f = run.observations, run.fitted
        rows.append(
            [
                name,
                o.recording,
                metres(o.length),
                str(len(o.frames)),
                f.solver if f else "–",
                millimetres(f.rms_fit) if f else "–",
                millimetres(f.rms_heldout) if f else "–",
                millimetres(o.noise_distance),
            ]
        )
    head = ["run", "recording", "length", "frames", "solver", "fitted", "held out", "noise"]
    return table(head, rows, (3, 5, 6, 7))


def _values(runs: Sequence[Named]) -> dict[str, dict[str, Parameter]]:
    """Return {parameter: {run: value}} of the first parameter set of every run."""
    out: dict[str, dict[str, Parameter]] = {}
    for name, run in runs:
        if run.fitted is not None:
            for key, p in next(iter(run.fitted.groups.values())).parameters.items():
                out.setdefault(key, {})[name] = p
    return out


def _disagree(p: Parameter, q: Parameter) -> bool | None:
    """Return whether the intervals do not meet; None where one has none or another unit."""
    if p.ci95 is None or q.ci95 is None or p.unit != q.unit:
        return None
    return p.ci95[1] < q.ci95[0] or q.ci95[1] < p.ci95[0]


def _parameters(runs: Sequence[Named]) -> Markup:
    body, figures = Markup(""), []
    rows = []
    for key, values in _values(runs).items():
        for name, p in values.items():
            interval = "–"
            if p.ci95 is not None:
                interval = with_unit(f"{number(p.ci95[0])} … {number(p.ci95[1])}", p.unit)
            elif p.below is not None:
                interval = with_unit(f"below {number(p.below)}", p.unit)
            value = with_unit(number(p.value), p.unit)
            rows.append([symbol(key), name, value, interval, p.verdict])
        for unit in dict.fromkeys(p.unit for p in values.values()):  # some over the weight, say
            alike = {n: p for n, p in values.items() if p.unit == unit and p.ci95 is not None}
            if len(alike) > 1:
                figures.append(_intervals(key, alike))
    body += table(["parameter", "run", "value", "95 % interval", "verdict"], rows)
    return body + Markup("").join(map(plot, figures))


def _intervals(key: str, values: dict[str, Parameter]) -> Figure:
    traces = []
    for name, p in values.items():
        if p.ci95 is None or not all(map(math.isfinite, p.ci95)):
            continue
        at = numbers([p.ci95[0], p.value, p.ci95[1]])
        traces.append(
            {"type": "scatter", "mode": "lines+markers", "x": at, "y": [name] * 3, "name": name}
            | {"line": {"color": NOMINAL, "width": 2}, "marker": {"color": NOMINAL, "size": 7}}
        )
    unit = unit_text(next(iter(values.values())).unit)
    title = f"{symbol(key)} ({unit})" if unit else str(symbol(key))
    return Figure(
        f"{key} in every run",
        traces,
        plane(axis(title), axis("", reversed=True), showlegend=False),
        "Value and both ends of its 95 % interval.",
        height=90 + 40 * len(traces),
    )


def _fits(runs: Sequence[Named]) -> Markup:
    names = [name for name, run in runs if run.fitted]
    fitted = [(run, run.fitted) for _, run in runs if run.fitted]
    if not fitted:
        return paragraph("No model has been fitted in any of these runs.")
    bars = [
        ("fitted frames", "soft", [f.rms_fit for _, f in fitted]),
        ("held-out frames", NOMINAL, [f.rms_heldout or math.nan for _, f in fitted]),
        ("noise of a point", RECORDED, [run.observations.noise_distance for run, _ in fitted]),
    ]
    figure = Figure(
        "Distance between simulation and points",
        [
            {"type": "bar", "name": name, "x": names, "y": numbers([1e3 * v for v in values])}
            | {"marker": {"color": colour}}
            for name, colour, values in bars
        ],
        plane(axis(""), axis("rms distance (mm)", rangemode="tozero")),
        "Frames of different recordings differ in how much they ask of a model: compare with the "
        "noise as well as with each other.",
    )
    return pair(figure)


def _answers(runs: Sequence[Named]) -> Markup:
    body = Markup("")
    for name, run in runs:
        body += heading(name) + Markup("").join(map(paragraph, answer(run)))
        made = (run.observations, run.model, run.diagnosis, run.control)
        stamps = {a.file_name: a.provenance.created.replace("T", " ") for a in made if a}
        body += facts(stamps)
    return body
