"""Candidates fitted from the rope as it is known from another recording.

Where an effect is missing, the nominal fit compensates with rigidity, rest shape and errors of the
set-up, far beyond their priors. Fits that begin there may stop in narrow valleys, far from their
minimum, and a scan about that rope misleads. Here the scan and the fits begin at the prior means:
at the sizes that explain the recording best while all else stays as known.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ropefit.diagnosis.beginning import settled_start
from ropefit.diagnosis.candidate import (
    TOLERANCE,
    Candidate,
    best_of,
    compared_if_comparable,
)
from ropefit.diagnosis.coarse_mesh import on_coarse_mesh
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.leaders import leading
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.terms import Term

EVALUATIONS = 12  # before the fit follows its valley
FAR_OFF = 10.0  # times the model's cost: no valley leads from there

Begun = tuple[Hypothesis, Term, Fit]


def from_known_rope(
    current: Fit, threshold: float, names: tuple[str, ...] | None
) -> list[Candidate]:
    """Return candidates on top of a model, best first, fitted from its values as known; none where
    the rope is not known, or explains the recording nearly as well as known.

    threshold [nats]: evidence that makes a difference; names: of the effects that may be proposed,
    None for all. Those whose fits on the coarse mesh explain more than the model are fitted on the
    whole one.
    """
    known = _as_known(current)
    if known is None or 0.5 * (known.cost - current.cost) < threshold:
        return []
    coarse = on_coarse_mesh(known)
    coarse = replace(coarse, jacobian=np.zeros_like(coarse.jacobian))  # it gives way to nothing
    scan = Scan(coarse, partial(sensitivities, coarse, [], names))
    leaders, _ = leading(scan.scores, threshold, known.point.setup)
    begun: dict[tuple[str, int], Begun] = {}
    for choices in leaders:
        hypothesis, start = choices[0]
        one = _begun(coarse, hypothesis, start, current) if hypothesis.effect.changes else None
        best = begun.get(hypothesis.key)
        if one is not None and (best is None or one[2].cost < best[2].cost):
            begun[hypothesis.key] = one
    better = [one for one in begun.values() if one[2].cost < current.cost]
    return best_of([_on_whole_mesh(known, current, *one) for one in better])


def _as_known(current: Fit) -> Fit | None:
    """Return the model with all that has a prior as known; None where the rope itself has none, or
    does not settle so."""
    rope = [np.isfinite(t.prior).all() for t in current.forward.terms if t.name == "EI"]
    at_rest = current.forward.instantaneous and not current.point.setup.potentials
    if not at_rest or not current.problem.data.material or not (rope and rope[0]):
        return None
    u = np.where(current.prior.held, 0.0, current.point.u)
    forward = current.forward.starting_from(current.point.solution)
    known = attempted(forward, current.problem, u, evaluations=1, tolerance=TOLERANCE)
    if known is None or not known.point.converged.all() or len(known.z) != len(current.z):
        return None
    return known


def _begun(coarse: Fit, hypothesis: Hypothesis, start: np.ndarray, current: Fit) -> Begun | None:
    """Return a hypothesis, its term, and its fit on the coarse mesh, along its valley unless it is
    far off."""
    at = settled_start(coarse, [(hypothesis, start)])
    if at is None:
        return None
    fitted = attempted(at.forward, coarse.problem, at.values, EVALUATIONS, TOLERANCE)
    if fitted is not None and fitted.cost < FAR_OFF * current.cost:
        forward = fitted.forward.starting_from(fitted.point.solution)
        fitted = attempted(
            forward, coarse.problem, fitted.point.u, EVALUATIONS, TOLERANCE, thorough=True
        )
    return None if fitted is None else (hypothesis, at.terms[0], fitted)


def _on_whole_mesh(
    known: Fit, current: Fit, hypothesis: Hypothesis, term: Term, coarse: Fit
) -> Candidate | None:
    states = coarse.point.solution.of_segments(known.forward.base.segments)
    forward = known.forward.with_terms([*known.forward.terms, term], states)
    fitted = attempted(
        forward, current.problem, coarse.point.u, EVALUATIONS, TOLERANCE, thorough=True
    )
    return compared_if_comparable(hypothesis, term, current, fitted)
