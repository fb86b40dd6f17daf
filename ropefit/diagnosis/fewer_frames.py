"""What was found with more frames, fitted to those that are left.

With an effect, frames may be at the edge of their stability that were not without it. The search
without them begins with what was found with them, and looks for what else there is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.accepted import Accepted, accept, close_cost
from ropefit.diagnosis.candidate import (
    EVALUATIONS,
    TOLERANCE,
    best_of,
    comparable,
    compared,
    fit_candidate,
)
from ropefit.diagnosis.reassessment import without_effects
from ropefit.inference.least_squares import Fit, attempted


@dataclass(frozen=True)
class FoundBefore:
    """The effects that a search accepted, its last fit, and which of its frames are left (f,)."""

    accepted: list[Accepted]
    final: Fit
    left: np.ndarray


def found_again(
    current: Fit, before: FoundBefore, threshold: float, tried: int
) -> tuple[Fit, list[Accepted]] | None:
    """Return the fit with all effects that were found with more frames, and these as accepted.

    None where there are none, where their fits are slow, and where one would not be accepted beside
    the others, or not by the same name. current: the model without any, of the frames that are
    left; tried: how many hypotheses were scanned.
    """
    effects = [one.candidate.hypothesis.effect for one in before.accepted]
    if not effects or any(effect.slow or effect.path_dependent for effect in effects):
        return None
    model = before.final.forward
    forward = current.forward.with_terms(
        model.terms, before.final.point.solution.frames(before.left)
    )
    whole = attempted(
        forward, current.problem, before.final.point.u, EVALUATIONS, TOLERANCE, thorough=True
    )
    if whole is None or not comparable(whole, current):
        return None
    out = []
    for one in before.accepted:
        without = without_effects(whole, one.candidate)
        if without is None or not comparable(whole, without):
            return None
        held = compared(one.candidate.hypothesis, one.candidate.term, without, whole)
        if held.evidence < threshold or refusal(held, without):
            return None
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
