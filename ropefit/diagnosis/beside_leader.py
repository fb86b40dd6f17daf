"""The noise of a motion beside the leading candidate: what that explains was no noise.

To first order, no effect explains much of a motion that has come out of step, and its mismatch is
taken for noise. A candidate fitted in full shows how little of it is.
"""

from __future__ import annotations

from ropefit.diagnosis.accepted import least_evidence
from ropefit.diagnosis.candidate import EVALUATIONS, Candidate, best_of, compared
from ropefit.diagnosis.wander import wandering_noise
from ropefit.inference.least_squares import Fit, attempted, fit

MUCH_LESS = 0.5  # of the noise assumed: what a candidate leaves shows that it was the mismatch
MOST_COMPARED = 4  # candidates compared again
REFITTED = 5  # evaluations of the smaller model


def with_noise_beside_leader(
    current: Fit, candidates: list[Candidate], threshold: float
) -> tuple[Fit, list[Candidate]]:
    """Return the smaller model and the candidates, fitted with the noise that the leader leaves if
    that is much less; highest evidence first. threshold [nats]: of evidence that counts."""
    if current.forward.instantaneous or not candidates:
        return current, candidates
    noise = wandering_noise(min(candidates, key=lambda c: c.fit.cost).fit, [])
    if noise.marker > MUCH_LESS * current.problem.noise.marker:
        return current, candidates
    problem = current.problem.under(noise)
    smaller = fit(current.forward, problem, current.point.u, REFITTED, tolerance=1e-5)
    again: list[Candidate | None] = []
    for one in sorted(candidates, key=lambda c: c.fit.cost)[:MOST_COMPARED]:
        best = max((c.evidence for c in again if c), default=0.0)
        fitted = attempted(
            one.fit.forward, problem, one.fit.point.u, EVALUATIONS, tolerance=1e-5,
            needed=smaller.cost - 2 * least_evidence(threshold, best),
        )  # fmt: skip
        if fitted is not None and len(fitted.z) == len(smaller.z):
            again.append(compared(one.hypothesis, one.term, smaller, fitted))
    return smaller, best_of(again)
