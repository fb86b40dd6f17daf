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
from ropefit.diagnosis.full_scan import Scan, sensitivities
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.leaders import leading
from ropefit.inference.least_squares import Fit, attempted

EVALUATIONS = 12  # before the fit follows its valley


def from_known_rope(
    current: Fit, threshold: float, names: tuple[str, ...] | None
) -> list[Candidate]:
    """Return candidates on top of a model, best first, fitted from its values as known; none where
    the rope is not known, or explains the recording nearly as well as known.

    threshold [nats]: evidence that makes a difference; names: of the effects that may be proposed,
    None for all.
    """
    known = _as_known(current)
    if known is None or 0.5 * (known.cost - current.cost) < threshold:
        return []
    scan = Scan(known, partial(sensitivities, known, [], names))
    leaders, _ = leading(scan.scores, threshold, known.point.setup)
    starts = [choices[0] for choices in leaders if choices[0][0].effect.changes]
    return best_of([_fitted(known, current, *start) for start in starts])


def _as_known(current: Fit) -> Fit | None:
    """Return the model with all that has a prior as known; None where the rope itself has none, or
    does not settle so."""
    rope = [np.isfinite(t.prior).all() for t in current.forward.terms if t.name == "EI"]
    at_rest = current.forward.instantaneous and not current.point.setup.potentials
    if not at_rest or not current.problem.data.material or not (rope and rope[0]):
        return None
    u = np.where(np.isfinite(current.prior), 0.0, current.point.u)
    forward = current.forward.starting_from(current.point.solution)
    known = attempted(forward, current.problem, u, evaluations=1, tolerance=TOLERANCE)
    if known is None or not known.point.converged.all() or len(known.z) != len(current.z):
        return None
    return replace(known, jacobian=np.zeros_like(known.jacobian))  # it gives way to nothing


def _fitted(
    known: Fit, current: Fit, hypothesis: Hypothesis, start: np.ndarray
) -> Candidate | None:
    begun = settled_start(known, [(hypothesis, start)])
    if begun is None:
        return None
    fitted = attempted(
        begun.forward, current.problem, begun.values, EVALUATIONS, TOLERANCE, thorough=True
    )
    return compared_if_comparable(hypothesis, begun.terms[0], current, fitted)
