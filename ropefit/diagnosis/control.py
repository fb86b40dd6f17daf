"""The control: what a candidate explains of a recording in which nothing was changed.

Where the nominal model misses more than noise, what it misses can look like an effect. The nominal
run's own recording tells how much: there a change has nothing to explain. And a law of the rope's
material is the same in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ropefit.diagnosis.accepted import CLOSE_EVIDENCE
from ropefit.diagnosis.candidate import EVALUATIONS, TOLERANCE, Candidate, fit_candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.rules import Selection
from ropefit.inference.least_squares import Fit, attempted

AS_FOUND = 1e-3  # search variables, one sigma: values that are held
IN_BOTH = "it explains the nominal recording as well, and is no change"
HARDLY_MORE = "it explains hardly more than what the nominal recording misses as well"
CONTRADICTED = "a law of the rope, which the nominal recording contradicts"


@dataclass(frozen=True)
class Controlled(Selection):
    """Candidates must explain more than they do of the nominal recording: `control`, the nominal
    model as fitted there."""

    control: Fit

    def supported(
        self, candidates: list[Candidate], threshold: float, current: Fit, refused: list[str]
    ) -> list[Candidate]:
        """Return the candidates that the control does not refute, that do not explain significantly
        less than those that it refutes, and that explain more than what those explain of the
        control: as much may be missed in both. Why others are not is added to `refused`."""
        # Others are neither accepted nor as good, whatever the control says of them.
        close = CLOSE_EVIDENCE * max((c.evidence for c in candidates), default=0.0)
        possible = [c for c in candidates if c.evidence >= max(threshold, close)]
        if not possible:
            return candidates
        noise = replace(current.problem.noise, ends=None, unequal=None)
        control = attempted(
            self.control.forward.starting_from(self.control.point.solution),
            self.control.problem.under(noise), self.control.point.u, EVALUATIONS, TOLERANCE,
        )  # fmt: skip
        if control is None:
            return candidates
        compared = [(c, refuted(c, control, threshold)) for c in possible]
        beaten = {id(c): c for c, found in compared if found.why}
        if not beaten:
            return candidates
        refused += [f"{c.hypothesis.name}: {found.why}" for c, found in compared if found.why]
        least = max(c.evidence for c in beaten.values()) - TIE_NATS
        # What may stand for something else in each recording says nothing of the other.
        specific = [
            found.there
            for c, found in compared
            if found.why and not c.hypothesis.effect.stands_for_others
        ]
        in_both = max(specific, default=0.0)
        kept = []
        for c in candidates:
            if id(c) in beaten or c.evidence < least:
                continue
            if c.evidence - in_both >= threshold:
                kept.append(c)
            elif c.evidence >= threshold:
                refused.append(f"{c.hypothesis.name}: {HARDLY_MORE}")
        return kept


class Refuted(NamedTuple):
    """Why a candidate is no change from the control, empty if it may be one; and its log evidence
    there [nats], 0 where it need not be known."""

    why: str
    there: float = 0.0


def refuted(candidate: Candidate, control: Fit, threshold: float) -> Refuted:
    """Compare a candidate with what it explains of the control."""
    effect = candidate.hypothesis.effect
    if not effect.possible(control.forward.base):
        return Refuted("")
    if effect.changes:
        if candidate.evidence - 0.5 * control.cost >= threshold:
            return Refuted("")  # however it is fitted: no more is left to explain there
        fitted = fit_candidate(control, candidate.hypothesis, candidate.values())
        there = fitted.evidence if fitted else 0.0
    else:
        there = _as_found(candidate, control)
        if there < -TIE_NATS:
            return Refuted(CONTRADICTED)
    there = max(there, 0.0)
    return Refuted(IN_BOTH if candidate.evidence - there < threshold else "", there)


def _as_found(candidate: Candidate, control: Fit) -> float:
    """Return what a candidate with its values explains of the control [nats]."""
    term = candidate.hypothesis.term(control.forward.base, candidate.values())
    held = replace(term, prior=np.full(term.size, AS_FOUND))
    forward = control.forward.with_terms([*control.forward.terms, held], control.point.solution)
    begin = np.concatenate([control.point.u, np.zeros(term.size)])
    fitted = attempted(forward, control.problem, begin, EVALUATIONS, TOLERANCE)
    if fitted is None or len(fitted.z) != len(control.z):
        return -np.inf
    return 0.5 * (control.cost - fitted.cost) / max(1.0, fitted.spread)
