"""What was found with more frames, fitted to those that are left.

With effects, frames may be at the edge of their stability that were not without them. The search is
repeated without these frames, as they may have misled it, but pairs of effects take long: where two
were found that still explain more than any single one, no others are looked for. Neither is what
explains the recording beside the rope as it is known from elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.accepted import Accepted, accept, close_cost
from ropefit.diagnosis.candidate import (
    EVALUATIONS,
    TOLERANCE,
    Candidate,
    best_of,
    comparable,
    compared,
    compared_if_comparable,
    fit_candidate,
)
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.pairs import together
from ropefit.diagnosis.reassessment import without_effects
from ropefit.inference.least_squares import Fit, attempted


@dataclass(frozen=True)
class FoundBefore:
    """The effects that a search accepted, its last fit, its candidates beside the rope as known
    from elsewhere, and which of its frames are left (f,)."""

    accepted: list[Accepted]
    final: Fit
    of_known: list[Candidate]
    left: np.ndarray

    def again(self, current: Fit, found: Fit) -> Fit | None:
        """Return a fit of that search continued with the frames that are left."""
        states = found.point.solution.frames(self.left)
        forward = current.forward.with_terms(found.forward.terms, states)
        u = found.point.u
        return attempted(forward, current.problem, u, EVALUATIONS, TOLERANCE, thorough=True)


def known_again(current: Fit, before: FoundBefore) -> list[Candidate]:
    """Return the candidates beside the rope as known, fitted again, best first."""
    return best_of(
        [
            compared_if_comparable(c.hypothesis, c.term, current, before.again(current, c.fit))
            for c in before.of_known
        ]
    )


def pair_again(
    current: Fit, before: FoundBefore, singles: list[Candidate], threshold: float, tried: int
) -> tuple[Fit, list[Accepted]] | None:
    """Return the fit with the two effects that were found with more frames, and these as accepted.

    None where they are not two, where their fits are slow, where one would not be accepted beside
    the other, or not by the same name, and where they do not explain more than the best of the
    `singles`, highest evidence first, by more than a tie. current: the model without any, of the
    frames that are left; tried: how many hypotheses were scanned.
    """
    effects = [one.candidate.hypothesis.effect for one in before.accepted]
    if len(effects) != 2 or any(effect.slow or effect.path_dependent for effect in effects):
        return None
    whole = before.again(current, before.final)
    if whole is None or not comparable(whole, current):
        return None
    if singles and together(current, whole) <= singles[0].evidence + TIE_NATS:
        return None
    beside: list[tuple[Fit, Candidate]] = []
    for one in before.accepted:
        without = without_effects(whole, one.candidate)
        if without is None or not comparable(whole, without):
            return None
        held = compared(one.candidate.hypothesis, one.candidate.term, without, whole)
        if held.evidence < threshold or refusal(held, without):
            return None
        beside.append((without, held))
    out = []
    for one, (without, held) in zip(before.accepted, beside, strict=True):
        close = close_cost(without, whole)
        others = [
            fit_candidate(without, c.hypothesis, c.values(), needed=close)
            for c in (*one.equivalent, *one.beaten)
        ]
        now = accept(held, best_of([held, *others]), without, tried)
        if now.candidate is not held:
            return None
        out.append(now)
    return whole, out
