"""An accepted effect."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ropefit.inference.diagnosis.ties import equivalents, ordered
from ropefit.inference.diagnosis.weigh import Rival
from ropefit.inference.least_squares import Fit

CLOSE = 0.5  # of the winner's evidence: rivals with less do not win with others known either
MOST = 3


@dataclass
class Found:
    """An accepted effect, the rivals that explain as much, how sure it is, and what it beat."""

    rival: Rival
    equivalent: list[Rival]
    evidence: float
    p_value: float
    beaten: list[Rival] = field(default_factory=list)


def found(winner: Rival, rivals: list[Rival], without: Fit, looks: int) -> Found:
    """The winner among rivals, or what is named in its stead; without: the model without any of
    them; looks: how many families were looked for."""
    first, same = ordered(winner, equivalents(winner, rivals, without.cost))
    p = min(1.0, looks * float(np.exp(-min(first.evidence, 690.0))))
    close = [r for r in rivals if r is not first and r.evidence > CLOSE * first.evidence]
    return Found(first, same, first.evidence, max(p, 1e-300), close[:MOST])
