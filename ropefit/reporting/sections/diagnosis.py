"""What was left out: causes in words, where model and data differ, before and after."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.artifacts.diagnosis import Cause, Size
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    AFTER,
    BEFORE,
    MANY,
    OBSERVED,
    Figure,
    axis,
    heat,
    line,
    numbers,
    plane,
)
from ropefit.reporting.html import bullets, facts, heading, pair, paragraph, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import millimetres, number, ranges, with_unit

SHOWN = 12  # candidates of the scan
ALONG = 6  # places at least: fewer are no places on the rope, but values of a law's own number
VERDICTS = {
    "none": "Nothing was left out that this recording could show: what the nominal model does not "
    "explain is noise.",
    "found": "Something was left out, and the catalogue explains it.",
    "unknown": "Something was left out that no effect of the catalogue explains.",
}


class DiagnosisSection(Section):
    """Causes, evidence, maps of the misfit, latent force, and what would have been seen."""

    title = "What was left out"

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        body = paragraph(VERDICTS[d.verdict])
        body += bullets(
            [f"{c.sentence[0].upper()}{c.sentence[1:]}.{_or_else(c)}" for c in d.causes.values()]
        )
        body += facts(
            {
                "Held-out frames, before": millimetres(d.rms_before),
                "Held-out frames, after": millimetres(d.rms_after),
                "Noise of a point": millimetres(d.noise_white),
                "Evidence needed": f"{number(d.threshold)} nats",
            },
            "key",
        )
        if d.causes:
            body += _causes(d)
        if d.refused:
            body += paragraph(
                "Not believed, or not to be told: " + "; ".join(d.refused) + ".", "note"
            )
        body += pair(_scan(d), _places(d))
        if d.causes:
            body += heading("Before and after") + pair(_heldout(d), _by_frame(d))
            body += pair(_map(d, before=True), _map(d, before=False))
        else:  # after is before
            body += pair(_heldout(d), _map(d, before=True))
        return body + _detectable(d)


def _or_else(c: Cause) -> str:
    if not c.equivalent_to:
        return ""
    return (
        f" The same shapes follow from {' or '.join(c.equivalent_to)}: they cannot be told apart."
    )


def _size(key: str, s: Size) -> str:
    interval = f"({number(s.ci95[0])} … {number(s.ci95[1])})"
    return with_unit(f"{key.replace('_', ' ')} {number(s.value)} {interval}", s.unit)


def _causes(d: Diagnosis) -> Markup:
    rows = []
    for c in d.causes.values():
        where = "–"
        if c.arc_length is not None:
            where = f"{number(c.arc_length[0])} … {number(c.arc_length[1])} m"
        key, first = next(iter(c.parameters.items()))
        rows.append(
            [
                c.name, c.kind, where, ranges(c.frames), _size(key, first),
                f"{number(c.log_evidence, 4)} nats", ", ".join(c.equivalent_to) or "–",
            ]
        )  # fmt: skip
    head = ["what", "kind", "where", "frames", "size (95 %)", "evidence", "or as well"]
    return heading("Causes") + table(head, rows)


def _map(d: Diagnosis, before: bool) -> Figure:
    values = d.misfit_before if before else d.misfit_after
    both = np.concatenate([d.misfit_before[np.isfinite(d.misfit_before)], [1e-4]])
    colours = heat(d.frames, d.station_arc, 1e3 * values.T, "mm")
    colours |= {"zmin": 0, "zmax": float(1e3 * np.quantile(both, 0.99))}
    colours["hovertemplate"] = "frame %{x}, s = %{y} m: %{z} mm<extra></extra>"
    which = "nominal model" if before else "model with the causes"
    return Figure(
        f"Misfit of the {which}",
        [colours],
        plane(axis("frame"), axis("arc length s (m)")),
        f"Mean offset of the data from the {which}, station by station. Blank: not seen.",
    )


def _scan(d: Diagnosis) -> Figure:
    best: dict[str, float] = {}
    for c in d.scan.values():
        best[c.name] = max(best.get(c.name, -np.inf), c.log_factor)
    names = sorted(best, key=lambda n: best[n])[-SHOWN:]
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": numbers([best[n] for n in names]),
        "y": names,
        "marker": {"color": AFTER},
        "name": "log Bayes factor",
    }
    return Figure(
        "Score scan",
        [bars],
        plane(
            axis("log Bayes factor (nats)", zeroline=True),
            axis("", showline=False),
            showlegend=False,
        ),
        "How much each effect would explain of what the nominal model left, before any was fitted. "
        f"Below {number(d.threshold)} nats it is chance; below zero the data speak against it.",
    )


def _places(d: Diagnosis) -> Figure:
    traces = []
    ranked = sorted(d.scan.values(), key=lambda c: -c.log_factor)
    for c in ranked:
        if c.place.shape[1] == 1 and len(c.place) >= ALONG and len(traces) < 4:
            colour = MANY[len(traces) % len(MANY)]
            traces.append(line(c.place[:, 0], c.by_place, c.name, colour))
    return Figure(
        "Where on the rope",
        traces or [line([], [], "", BEFORE)],
        plane(axis("arc length s (m)"), axis("log Bayes factor (nats)")),
        "The same for effects at one point, by place.",
    )


def _heldout(d: Diagnosis) -> Figure:
    """Held-out frames: distance left, and what each cause gains in every block of them."""
    if d.causes:
        traces = [
            {
                "type": "bar",
                "name": f"{c.name}{f' {k + 1}' if len(d.causes) > 1 else ''}",
                "x": [f"block {i + 1}" for i in range(len(c.heldout_gain))],
                "y": numbers(c.heldout_gain),
                "marker": {"color": MANY[k % len(MANY)]},
            }
            for k, c in enumerate(d.causes.values())
        ]
        return Figure(
            "Gain in held-out frames",
            traces,
            plane(axis(""), axis("gain (nats)"), barmode="group"),
            "Each block of frames was left out of a fit and predicted: how much better with the "
            "cause than without it. Above zero: it helps where it was not fitted.",
        )
    sizes = {"left": d.rms_before, "noise": d.noise_white}
    bars = {
        "type": "bar",
        "x": list(sizes),
        "y": numbers([1e3 * v for v in sizes.values()]),
        "marker": {"color": [AFTER, OBSERVED]},
        "name": "rms",
    }
    return Figure(
        "Distance left in held-out frames",
        [bars],
        plane(axis(""), axis("rms distance (mm)", rangemode="tozero"), showlegend=False),
        "Frames left out of the fit and predicted by it, and the noise of a point.",
    )


def _by_frame(d: Diagnosis) -> Figure:
    """rms over the rope of the mean offset of the stations, frame by frame."""
    rms = [1e3 * np.sqrt(np.nanmean(m**2, axis=1)) for m in (d.misfit_before, d.misfit_after)]
    return Figure(
        "Misfit of every frame, before and after",
        [
            line(d.frames, rms[0], "nominal model", BEFORE),
            line(d.frames, rms[1], "with the causes", AFTER),
        ],
        plane(axis("frame"), axis("rms of the mean offsets (mm)", rangemode="tozero")),
        "The maps below, one number a frame.",
    )


def _detectable(d: Diagnosis) -> Markup:
    rows = [
        [name.replace("_", " "), with_unit(number(item.value), item.unit)]
        for name, item in sorted(d.detectable.items())
    ]
    return (
        heading("What this recording would have shown")
        + paragraph("Sizes from which each effect would have been found here, typically.", "note")
        + table(["effect", "size"], rows)
    )
