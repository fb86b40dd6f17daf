"""Why this and not that: the candidates by their evidence, ties, and what was refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import bullets, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import number, ranges, strength

SHOWN = 7  # candidates
WORDS = {
    "found": "How much better each candidate explains what the nominal model leaves.",
    "unknown": "No candidate explains enough of what the nominal model leaves to be the cause.",
    "none": "No candidate explains more of what the nominal model leaves than chance would.",
}
TOGETHER = "What each cause explains beyond the others."
ALONE = (
    "What every other candidate would explain if it were the only cause. Beside the causes above, "
    "none explains enough."
)


@dataclass(frozen=True)
class Row:
    """A candidate: its evidence, whether it was accepted, and whether it is tied with that."""

    name: str
    nats: float
    accepted: bool = False
    tied: bool = False


class WhySection(Section):
    """A bar each; words before numbers."""

    title = "Why this and not that"

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        rows = candidates(d)
        body = paragraph(WORDS[d.verdict])
        if len(d.causes) > 1:  # evidence beside different models is not to be compared
            chosen = [row for row in rows if row.accepted or row.tied]
            rest = [row for row in rows if row not in chosen]
            body = paragraph(TOGETHER) + _bars(chosen, d.threshold)
            body += paragraph(ALONE) + _bars(rest, d.threshold)
        elif d.verdict != "none":
            body += _bars(rows, d.threshold)
        elif rows:
            best = rows[0]
            body += paragraph(f"The best of {len(rows)} is {_name(best.name)}: {_text(best, d)}.")
        notes = []
        if any(row.tied for row in rows):
            notes.append(
                "Joined by a bracket: they predict the same shapes here, so that this recording "
                "cannot tell them apart."
            )
        if d.refused:
            notes += [f"Refused: {_name(text)}." for text in d.refused]
        for reason in dict.fromkeys(item.reason for item in d.dropped):
            frames = ranges(item.frame for item in d.dropped if item.reason == reason)
            notes.append(f"Excluded, {reason}: frames {frames}.")
        notes.append(
            f"Evidence is in nats (natural logarithm of the odds): below {number(d.threshold, 2)} "
            "it may be chance in this recording, from there it is strong, and from 100 times these "
            "odds decisive."
        )
        return body + bullets(notes)


def candidates(d: Diagnosis) -> list[Row]:
    """Return the accepted causes, each with what it is tied with, then the others by evidence."""
    best: dict[str, float] = {}
    for c in d.scan.values():
        best[c.name] = max(best.get(c.name, -np.inf), c.log_factor)
    rows = []
    for cause in d.causes.values():
        best.pop(cause.name, None)
        tied = [name for name in cause.equivalent_to if name not in {r.name for r in rows}]
        rows.append(Row(cause.name, cause.log_evidence, accepted=True, tied=bool(tied)))
        for name in tied:  # what the scan says of it is not as good as a fit
            best.pop(name, None)
            rows.append(Row(name, np.nan, tied=True))
    rest = sorted(best.items(), key=lambda item: -item[1])
    return rows + [Row(name, nats) for name, nats in rest]


def _bars(rows: list[Row], threshold: float) -> Markup:
    shown = [r for i, r in enumerate(rows) if r.accepted or r.tied or (i < SHOWN and r.nats > 0)]
    top = max([r.nats for r in shown if np.isfinite(r.nats)] + [threshold])
    items = Markup("")
    for row in shown:
        share = 100 * max(row.nats, 0.0) / top if np.isfinite(row.nats) else 0.0
        kinds = " ".join(k for k, on in (("accepted", row.accepted), ("tied", row.tied)) if on)
        items += Markup(
            '<li class="{}"><span class="who">{}</span><span class="track">'
            '<i style="width:{:.1f}%"></i></span><span class="how">{}</span></li>'
        ).format(kinds, _name(row.name), share, _strength(row, threshold))
    return Markup('<ol class="candidates">{}</ol>').format(items)


def _strength(row: Row, threshold: float) -> str:
    if not np.isfinite(row.nats):
        return "not ruled out"
    words = f"{strength(row.nats, threshold)}, {number(row.nats)} nats"
    return f"{words}, accepted" if row.accepted else words


def _text(row: Row, d: Diagnosis) -> str:
    return f"the evidence is {strength(row.nats, d.threshold)} ({number(row.nats, 2)} nats)"


def _name(name: str) -> str:
    return name.replace("_", " ")
