"""An accepted effect: a candidate that passed, with those that explain as much."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ropefit.diagnosis.acceptance import refusal, ruled_out
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.equivalence import TIE_NATS, also_possible, equivalents, ordered
from ropefit.diagnosis.nested import (
    as_usual,
    is_special_case,
    with_general_cases,
    with_special_cases,
)
from ropefit.inference.least_squares import Fit

CLOSE_EVIDENCE = 0.5  # of the best's: candidates with less do not win beside other effects either
FURTHEST_BEHIND = 30.0  # nats, before the penalty for values: what is further is never as good
MOST_BEATEN = 3  # kept for reassessment
LEAST_P = 1e-300


@dataclass
class Accepted:
    """An accepted effect, candidates that explain as much or cannot be ruled out, its evidence and
    p-value, and the candidates that it beat."""

    candidate: Candidate
    equivalent: list[Candidate]
    evidence: float
    p_value: float
    beaten: list[Candidate] = field(default_factory=list)


def least_evidence(threshold: float, best: float) -> float:
    """Return the evidence [nats] from which a candidate counts beside the best one so far: it may
    be accepted, or wins beside other effects."""
    return max(threshold - TIE_NATS, CLOSE_EVIDENCE * best)


def close_cost(without: Fit, fitted: Fit) -> float:
    """Return the cost up to which a candidate may win beside other effects, or be as good: it
    explains so much of what a fitted one explains on top of the model without either, and is not
    further behind than its fewer values may make up for."""
    half = without.cost - CLOSE_EVIDENCE * (without.cost - fitted.cost)
    return min(half, fitted.cost + 2 * FURTHEST_BEHIND * max(1.0, fitted.spread))


def accept(best: Candidate, candidates: list[Candidate], without: Fit, tried: int) -> Accepted:
    """Accept the best of some candidates, or the one that is named first in a tie, if that is a
    special case of it or would be accepted by itself.

    without: the model without any of them; tried: how many hypotheses were scanned, for which the
    p-value is corrected (Bonferroni).
    """
    usual = as_usual(best, without, TIE_NATS)
    best, candidates = usual, [usual if c is best else c for c in candidates]
    candidates = with_general_cases(candidates, without)
    candidates = with_special_cases(best, candidates, without)
    tied = equivalents(best, candidates, without.cost)
    first, same = ordered(best, tied)
    special = is_special_case(first.hypothesis.effect, best.hypothesis.effect)
    if first is not best and not special and refusal(first, without):
        first, same = best, tied
    for one in also_possible(first, candidates, without.cost):
        if all(one is not c for c in (first, *same)) and not ruled_out(one, without):
            same = [*same, one]
    p = min(1.0, tried * float(np.exp(-min(first.evidence, 690.0))))
    close = [
        c for c in candidates if c is not first and c.evidence > CLOSE_EVIDENCE * first.evidence
    ]
    return Accepted(first, same, first.evidence, max(p, LEAST_P), close[:MOST_BEATEN])
