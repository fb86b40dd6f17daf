"""Which hypotheses of a scan are fitted, and from where."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ropefit.diagnosis.proposals import Start
from ropefit.diagnosis.scan import Score
from ropefit.rod.setup import Setup

MOST_LEADERS = 6
LEADER_SHARE = 0.5  # of the highest log factor, if that is below twice the threshold
FITTED_SHARE = 0.6  # of the threshold: least log factor of a leader that is fitted


def leading(
    scan: list[Score], threshold: float, setup: Setup
) -> tuple[list[list[Start]], list[list[Start]]]:
    """Return the starts of full fits that a scan, highest first, proposes: of the leaders, and of
    laws wherever they rank; and those of others that rank high.

    What is linear is tested in any case, as a law far from the linear one looks like several local
    effects. And where much is missed, the first order tells little of the order of the others, nor
    of how wide a stretch is: that a rope rests curved shows at the edges of the curved stretch.
    """
    highest = max((s.log_factor for s in scan), default=0.0)
    least = min(threshold, LEADER_SHARE * highest)
    every = [s for s in scan if s.log_factor > least]
    first, rest = every[:MOST_LEADERS], every[MOST_LEADERS:]
    laws = (s for s in scan if s.hypothesis.effect.law(setup) is not None)
    first += [s for s in laws if all(s is not f for f in first)]
    high = max(threshold, LEADER_SHARE * highest)
    rest = [s for s in rest if s.log_factor > high and all(s is not f for f in first)]
    fitted = (s for s in first if s.log_factor > FITTED_SHARE * threshold)
    leaders = [start for s in fitted for start in _from(s, s.starts())]
    further = [start for s in rest for start in _from(s, s.widths or s.starts())]
    high_ones = (s for s in first if s.log_factor > high)
    return leaders, further + [start for s in high_ones for start in _from(s, s.widths)]


def _from(score: Score, starts: Iterable[tuple[np.ndarray, np.ndarray]]) -> list[list[Start]]:
    return [[(score.hypothesis, np.concatenate(start))] for start in starts]
