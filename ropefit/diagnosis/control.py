"""The control: what a candidate explains of a recording in which nothing was changed.

Where the nominal model misses more than noise, what it misses can look like an effect. The nominal
run's own recording tells how much: there a change has nothing to explain. And a law of the rope's
material is the same in both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.diagnosis.accepted import CLOSE_EVIDENCE
from ropefit.diagnosis.candidate import EVALUATIONS, TOLERANCE, Candidate, fit_candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.rules import Selection
from ropefit.inference.least_squares import Fit, attempted

AS_FOUND = 1e-3  # search variables, one sigma: values that are held
IN_BOTH = "it explains the nominal recording as well, and is no change"
CONTRADICTED = "a law of the rope, which the nominal recording contradicts"


@dataclass(frozen=True)
class Controlled(Selection):
    """Candidates must explain more than they do of the nominal recording: `control`, the nominal
    model as fitted there."""

    control: Fit

    def supported(
        self, candidates: list[Candidate], threshold: float, current: Fit, refused: list[str]
    ) -> list[Candidate]:
        """Return the candidates that the control does not refute, and that do not explain
        significantly less than those that it refutes; why others are not is added to `refused`."""
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
        reasons = {id(c): refuted(c, control, threshold) for c in possible}
        beaten = [c for c in possible if reasons[id(c)]]
        refused += [f"{c.hypothesis.name}: {reasons[id(c)]}" for c in beaten]
        least = max((c.evidence for c in beaten), default=-np.inf) - TIE_NATS
        return [c for c in candidates if not reasons.get(id(c)) and c.evidence >= least]


def refuted(candidate: Candidate, control: Fit, threshold: float) -> str:
    """Return why a candidate is no change from the control; empty if it may be one."""
    effect = candidate.hypothesis.effect
    if not effect.possible(control.forward.base):
        return ""
    if effect.changes:
        if candidate.evidence - 0.5 * control.cost >= threshold:
            return ""  # whatever it is fitted to there: more than that is not left to explain
        fitted = fit_candidate(control, candidate.hypothesis, candidate.values())
        there = fitted.evidence if fitted else 0.0
    else:
        there = _as_found(candidate, control)
        if there < -TIE_NATS:
            return CONTRADICTED
    return IN_BOTH if candidate.evidence - max(there, 0.0) < threshold else ""


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
