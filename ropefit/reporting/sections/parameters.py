"""The identified numbers, nominal and with the cause, each with its interval drawn."""

from __future__ import annotations

from markupsafe import Markup

from ropefit.artifacts import Diagnosis, FittedModel, Parameter
from ropefit.artifacts.causes import Size
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import NOMINAL, WITH_CAUSE
from ropefit.reporting.html import paragraph, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.sections.equilibrium import mass_note
from ropefit.reporting.words import (
    common_power,
    digits_of,
    in_use,
    listed,
    number,
    symbol,
    with_unit,
)

VERDICTS = {
    "determined": "the data fix the value to within its interval",
    "trade-off": "only a combination with the parameters named is fixed",
    "flat direction": "a wide range of values fits as well",
    "dead": "the value makes no difference to these data",
    "at bound": "the search ended at the edge of its range",
}
MOST_ROWS = 24  # rows
WIDE, HIGH = 150, 10  # px of an interval bar


class ParametersSection(Section):
    """One table: the rope's parameters, and the sizes of what was missing."""

    title = "Parameters"

    def applies(self, run: RunContents) -> bool:
        return run.fitted is not None

    def render(self, run: RunContents) -> Markup:
        f = run.fitted
        assert f is not None
        d = run.diagnosis if run.diagnosis is not None and run.diagnosis.causes else None
        rows, used = _rows(f, d)
        head = ["parameter", "nominal", "with the cause", "95 % intervals", "", "meaning"]
        if d is None:
            rows, head = [row[:2] + row[3:] for row in rows], head[:2] + head[3:]
        text = ". ".join(f"{k.capitalize()}: {v}" for k, v in VERDICTS.items() if k in used)
        body = _caveat(f) + table(head, rows[:MOST_ROWS])
        if len(rows) > MOST_ROWS:
            body += paragraph(f"{MOST_ROWS} of {len(rows)} parameters are shown.", "note")
        return body + (paragraph(f"{text}.", "note") if text else Markup(""))


def _caveat(f: FittedModel) -> Markup:
    if f.iterated and not f.solver_converged:
        return paragraph(
            "The solver has not converged: these values belong to "
            f"{f.iterated.steps} × {f.iterated.iterations} iterations and would differ at "
            "another count. The intervals do not include that."
        )
    found = f.balance or f.stepped
    return paragraph(mass_note(found)) if found and not found.mass_known else Markup("")


def _rows(f: FittedModel, d: Diagnosis | None) -> tuple[list[list[object]], set[str]]:
    """Return the rows, and the verdicts in them."""
    rows, used = [], set()
    for count, group in enumerate(f.groups.values(), start=1):
        label = f", group {count}" if len(f.groups) > 1 else ""
        for name in group.free_names:
            p = group.parameters[name]
            along = d.rope.get(name) if d else None
            rows.append(_row(name, label, p, along))
            used.add(p.verdict)
    for cause in d.causes.values() if d else ():
        known = cause.law.parameters if cause.law else cause.parameters
        meaning = cause.sentence[:1].upper() + cause.sentence[1:]
        for name, size in _independent(known).items():
            label = Markup("{} of {}").format(name.replace("_", " "), cause.name.replace("_", " "))
            value, ci95, unit = in_use(size.value, size.ci95, size.unit)
            text = _value(value, ci95, unit, common_power([value, *ci95]))
            rows.append([label, "–", text, _bars(None, size), "", meaning])
            meaning = "as above"
    return rows, used


def _independent(sizes: dict[str, Size]) -> dict[str, Size]:
    """Return sizes without the components of a vector, and without what another is derived from."""

    def part(name: str) -> bool:
        return any(name.startswith(f"{o}_") or name.endswith(f"_{o}") for o in sizes)

    return {name: size for name, size in sizes.items() if not part(name)}


def _row(name: str, label: str, p: Parameter, along: Size | None) -> list[object]:
    sizes = [p] if along is None else [p, along]
    power = common_power(v for s in sizes for v in (s.value, *(s.ci95 or ())))
    value = _value(p.value, p.ci95, p.unit, power)
    if p.below is not None:
        value = with_unit(f"below {number(p.below)}", p.unit)
    kind = {"determined": "good"}.get(p.verdict, "warn")
    verdict: object = Markup('<span class="verdict {}">{}</span>').format(kind, p.verdict)
    if p.trades_with:
        verdict = Markup("{} with {}").format(verdict, listed(map(symbol, p.trades_with)))
    if along is not None:
        verdict = Markup("nominal: {}").format(verdict)
    return [
        Markup('<span title="{}">{}</span>{}').format(name, symbol(name), label),
        value,
        _value(along.value, along.ci95, along.unit, power) if along else "–",
        _bars(p, along),
        verdict,
        p.meaning,
    ]


def _value(value: float, ci95: tuple[float, float] | None, unit: str, power: int | None) -> Markup:
    """Return a value with its unit and its interval, written with one power of ten."""
    digits = digits_of(ci95, 3)
    text = with_unit(number(value, digits, power), unit)
    if ci95 is None:
        return Markup("{}, no interval").format(text)
    low, high = (number(v, digits, power) for v in ci95)
    return Markup('{} <span class="interval">{} … {}</span>').format(text, low, high)


def _bars(nominal: Parameter | None, along: Size | None) -> Markup:
    """Return both intervals on one scale, drawn."""
    both = [(nominal, NOMINAL), (along, WITH_CAUSE)]
    drawn = [(s.value, s.ci95, colour) for s, colour in both if s is not None and s.ci95]
    if not drawn:
        return Markup("")
    ends = [v for value, ci95, _ in drawn for v in (value, *ci95)]
    if nominal is None:
        ends.append(0.0)  # no cause at all
    low, high = min(ends), max(ends)
    scale = (WIDE - 12) / (high - low or 1.0)
    body = Markup("")
    for k, (value, ci95, colour) in enumerate(drawn):
        y = HIGH * (k + 0.5)
        a, b, at = (6 + scale * (v - low) for v in (*ci95, value))
        body += Markup(
            '<path d="M{:.1f},{}H{:.1f}" stroke="{}" stroke-width="3"/>'
            '<circle cx="{:.1f}" cy="{}" r="4" fill="{}"/>'
        ).format(a, y, b, colour, at, y, colour)
    if nominal is None:
        at = 6 - scale * low
        body += Markup('<path d="M{:.1f},0V{}" stroke="var(--soft)"/>').format(at, HIGH)
    return Markup('<svg class="intervals" width="{}" height="{}" role="img">{}</svg>').format(
        WIDE, HIGH * len(drawn), body
    )
