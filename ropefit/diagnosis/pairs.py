"""Two of a kind: one effect at two places at once, as of two weights on one rope.

One such effect alone lies somewhere between the two, or is taken for a wide one, and a search that
accepts one effect after the other begins from there. The scan over pairs of places costs no solve:
a pair's score follows from what is known of its places.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.candidate import EVALUATIONS, Candidate, compared, occam_factor
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.least_squares import Fit, attempted

PRIOR_SIZE = 3.0  # usual sizes: keeps the sizes of two places nearby from running away
LEAST_APART = 2  # places of the scan


def best_pair(
    current: Fit, known: list[Sensitivity], single: Candidate | None, threshold: float
) -> tuple[list[tuple[Candidate, Fit]], Fit] | None:
    """Return two candidates of one effect, each with the model without it, and the fit with both.

    None unless together they are better than the best single candidate, if any, and each of them
    passes every gate beside the other. known: sensitivities of the current model.
    """
    found = _scanned(current, known)
    saved = current.cost - single.fit.cost if single else 0.0
    if found is None or found[0] < saved + 2 * threshold:
        return None
    _, hypothesis, starts = found
    setup = current.forward.base
    terms = [hypothesis.term(setup, start) for start in starts]
    model = current.forward.with_terms([*current.forward.terms, *terms], current.point.solution)
    begin = np.concatenate([current.point.u, *(np.zeros(t.size) for t in terms)])
    both = attempted(model, current.problem, begin, EVALUATIONS, tolerance=1e-5)
    if both is None or not both.point.converged.all() or len(both.z) != len(current.z):
        return None
    own, out = current.forward.terms, []
    parts = dict(zip(map(id, model.terms), model.split(both.point.u), strict=True))
    for mine, other in (terms, terms[::-1]):
        fits = []
        for now in ([*own, other], [*own, other, mine]):
            forward = current.forward.with_terms(now, both.point.solution)
            u = np.concatenate([parts[id(term)] for term in now])
            fits.append(attempted(forward, current.problem, u, EVALUATIONS, tolerance=1e-5))
        without, whole = fits
        if without is None or whole is None or len(without.z) != len(whole.z):
            return None
        candidate = compared(hypothesis, mine, without, whole)
        if candidate.evidence < threshold or refusal(candidate, without):
            return None
        out.append((candidate, without))
    spread = max(1.0, both.spread)
    together = 0.5 * (current.cost - both.cost) / spread
    together -= sum(occam_factor(c.fit, c.term) for c, _ in out)
    alone = single.evidence if single else 0.0
    return (out, out[1][0].fit) if together > alone + TIE_NATS else None


def _scanned(
    current: Fit, known: list[Sensitivity]
) -> tuple[float, Hypothesis, tuple[np.ndarray, np.ndarray]] | None:
    """Return by how much a pair lowers χ² at most, to first order, its effect and its values."""
    project, best = Projection(current), None
    setup = current.forward.base
    for one in known:
        hypothesis = one.hypothesis
        if hypothesis.effect.locus != "point" or not hypothesis.effect.linear:
            continue
        many, k = one.values.shape[1:]
        flat = one.values.reshape(len(one.values), -1)
        a, b = flat.T @ project(flat), flat.T @ project.z
        scales = hypothesis.scales(setup)
        for p, q in combinations(range(many), 2):
            if q - p < LEAST_APART:
                continue
            rows = np.r_[k * p : k * p + k, k * q : k * q + k]
            sizes = np.linalg.solve(a[np.ix_(rows, rows)] + np.eye(2 * k) / PRIOR_SIZE**2, b[rows])
            gain = float(sizes @ b[rows])
            if hypothesis.positive and sizes.min() < 0:
                continue
            if best is None or gain > best[0]:
                values = [
                    np.concatenate([scales * part, hypothesis.places[place]])
                    for part, place in ((sizes[:k], p), (sizes[k:], q))
                ]
                best = gain, hypothesis, (values[0], values[1])
    return best
