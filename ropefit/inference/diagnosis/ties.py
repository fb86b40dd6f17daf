"""Rivals that explain as much as the winner does, and which of them is named first."""

from __future__ import annotations

import numpy as np

from ropefit.inference.diagnosis.families import NARROWEST
from ropefit.inference.diagnosis.weigh import Rival

SET_NATS = 3.0
SAME_SIGNAL, SAME_NATS = 0.98, 10.0  # of what the best one explains, and so little behind


def ordered(winner: Rival, same: list[Rival]) -> tuple[Rival, list[Rival]]:
    """The one that is named first and the others (DIAGNOSIS, section 5)."""
    return _measurement_first(*_simplest_first(winner, same))


def equivalents(winner: Rival, rivals: list[Rival], before: float) -> list[Rival]:
    """Rivals within reach of the best, or that explain nearly all that it does, and hardly worse.

    before: χ² of the model without any of them.
    """
    out = []
    for rival in rivals:
        if rival is winner or rival.family.name == winner.family.name or rival.clear() < 1:
            continue
        behind = winner.evidence - rival.evidence
        share = (before - rival.fit.cost) / max(before - winner.fit.cost, 1e-9)
        if behind < SET_NATS or (share > SAME_SIGNAL and behind < SAME_NATS):
            out.append(rival)
    return out


def _simplest_first(winner: Rival, same: list[Rival]) -> tuple[Rival, list[Rival]]:
    """In a tie the one with the fewest values is named first (DIAGNOSIS, section 5); a stretch too
    narrow to be resolved is a point."""
    width = dict(zip(winner.term.names, winner.values(), strict=True)).get("width", np.inf)
    length = float(winner.fit.forward.base.properties.length.sum())
    reach = SAME_NATS if width < 1.5 * NARROWEST * length else SET_NATS
    tied = [r for r in (winner, *same) if winner.evidence - r.evidence < reach]
    first = min(tied, key=lambda r: (r.term.size, -r.evidence))
    return first, [r for r in (winner, *same) if r is not first]


def _measurement_first(winner: Rival, same: list[Rival]) -> tuple[Rival, list[Rival]]:
    """If physics and measurement tie, the measurement is named first (DIAGNOSIS, section 5)."""
    if winner.family.effect.kind == "measurement":
        return winner, same
    for rival in same:
        if rival.family.effect.kind == "measurement":
            return rival, [winner, *(r for r in same if r is not rival)]
    return winner, same
