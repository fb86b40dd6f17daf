"""How sure: what was held out and predicted, and whether the intervals are honest on these data."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.reporting.contents import RunContents
from ropefit.reporting.figures import (
    CAUSE,
    MANY,
    NOMINAL,
    WITH_CAUSE,
    Figure,
    axis,
    evenly,
    line,
    numbers,
    plane,
)
from ropefit.reporting.html import pair, paragraph
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import percent

DRAWN = 200  # points of a distribution
SIMULTANEOUS = 1.358  # 95 % of the Kolmogorov statistic times the root of the count
HONEST = 0.03  # departure of an interval's coverage that does not mislead


class SureSection(Section):
    """The gain in every held-out block; the distribution of held-out data in their predictions."""

    title = "How sure"

    def applies(self, run: RunContents) -> bool:
        d = run.diagnosis
        return d is not None and (d.pit is not None or bool(d.causes))

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        figures = ([_blocks(d)] if d.causes else []) + ([_pit(d)] if d.pit is not None else [])
        return paragraph(" ".join(filter(None, (_held_out(d), _honest(d))))) + pair(*figures)


def _held_out(d: Diagnosis) -> str:
    text = []
    for c in d.causes.values():
        better, many = int((c.heldout_gain > 0).sum()), len(c.heldout_gain)
        name = f" with {c.name.replace('_', ' ')}" if len(d.causes) > 1 else ""
        text.append(
            f"In {better} of {many} held-out blocks of the recording, the "
            f"model{name or ' with the cause'} predicts better than the one without."
        )
    return " ".join(text)


def _honest(d: Diagnosis) -> str:
    if d.pit is None:
        return ""
    inside = float(np.mean((d.pit > 0.025) & (d.pit < 0.975)))
    text = f"95 % intervals for held-out data hold {percent(inside, 3)} of them"
    chance = 2 * np.sqrt(0.95 * 0.05 / len(d.pit))  # of few values
    if abs(inside - 0.95) <= max(HONEST, chance):
        return f"{text}: the stated uncertainties are honest on this recording."
    if inside > 0.95:
        return f"{text}: the stated uncertainties are too wide for this recording."
    return f"{text}: the stated uncertainties are too narrow for this recording."


def _blocks(d: Diagnosis) -> Figure:
    """Return what each cause gains in every held-out block."""
    several = len(d.causes) > 1
    traces = [
        {
            "type": "bar",
            "name": f"{c.name.replace('_', ' ')}{f' {k + 1}' if several else ''}",
            "x": [f"{i + 1}" for i in range(len(c.heldout_gain))],
            "y": numbers(c.heldout_gain),
            "marker": {"color": MANY[k % len(MANY)] if several else CAUSE},
        }
        for k, c in enumerate(d.causes.values())
    ]
    return Figure(
        "Gain in held-out blocks",
        traces,
        plane(axis("held-out block"), axis("gain (nats)")),
        "Above zero: the cause helps where it was not fitted.",
        height=260,
    )


def _pit(d: Diagnosis) -> Figure:
    """Return the distribution function of the held-out data's places in their predictive
    distributions, less the uniform one (Säilynoja et al. 2022)."""
    assert d.pit is not None
    count = len(d.pit)
    at = np.linspace(0, 1, DRAWN + 1)
    found = np.searchsorted(np.sort(d.pit), at, side="right") / max(count, 1) - at
    edge = np.full_like(at, SIMULTANEOUS / np.sqrt(max(count, 1)))
    style = {"line": {"dash": "dash", "width": 1.2}}
    colour = WITH_CAUSE if d.causes else NOMINAL
    some = evenly(len(at), DRAWN)
    return Figure(
        "Held-out data in their predictive distribution",
        [
            line(at[some], found[some], "observed minus expected", colour),
            line(at, edge, "95 % of honest models lie between", "soft", **style),
            line(at, -edge, "", "soft", showlegend=False, **style),
        ],
        plane(axis("predicted probability (1)"), axis("excess of data below it (1)")),
        f"Probability integral transform of {count} held-out values, as the distance of "
        "its distribution function from the uniform one. An S upwards on the left: intervals too "
        "narrow; downwards: too wide.",
        height=260,
    )
