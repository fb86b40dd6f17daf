"""The interval in which an effect acts, from a fit of its size in all stretches at once.

The scan tries one interval at a time on a rope that has the wrong shape as long as the effect is
left out; where the effect is large, the best interval of the scan is not the right one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.inference.least_squares import Fit, attempted
from ropefit.models.terms import SIZE_PRIOR_SD

STRETCHES = 10
NONLINEAR_START = 0.3  # usual sizes: effects without a tangent have no slope at zero
MOST_EVALUATIONS = 15


def significant_interval(smaller: Fit, hypothesis: Hypothesis) -> np.ndarray | None:
    """Return sizes, centre and width (k + 2,) in SI of the most significant interval.

    The sizes of a hypothesis are fitted in each of `STRETCHES` stretches at once, on top of a
    model. None where that fit fails.
    """
    setup = smaller.forward.base
    length = float(setup.properties.length.sum())
    width = length / STRETCHES
    centres = (np.arange(STRETCHES) + 0.5) * width
    zero = np.zeros(hypothesis.size)
    terms = []
    for centre in centres:
        term = hypothesis.term_at(setup, np.array([*zero, centre, width]))
        terms.append(replace(term, prior=SIZE_PRIOR_SD * term.scale))
    forward = smaller.forward.with_terms([*smaller.forward.terms, *terms], smaller.point.solution)
    own = STRETCHES * hypothesis.size
    small = 0.0 if hypothesis.effect.linear else NONLINEAR_START
    begin = np.concatenate([smaller.point.u, np.full(own, small)])
    fitted = attempted(forward, smaller.problem, begin, MOST_EVALUATIONS, tolerance=1e-4)
    if fitted is None:
        return None
    scale = np.tile(terms[0].scale, STRETCHES)
    values = (scale * fitted.point.u[-own:]).reshape(STRETCHES, hypothesis.size)
    precision = 1 / (scale * fitted.sd()[-own:]).reshape(STRETCHES, hypothesis.size) ** 2
    first, last, sizes = most_significant(values, precision)
    return np.array([*sizes, (first + last) / 2 * width, (last - first) * width])


def most_significant(values: np.ndarray, precision: np.ndarray) -> tuple[int, int, np.ndarray]:
    """Return the stretches first..last - 1 of values (B, k) whose weighted mean (k,) is the most
    standard errors from zero, and that mean."""
    best = (-np.inf, 0, 1, values[0])
    for first in range(len(values)):
        for last in range(first + 1, len(values) + 1):
            weight = precision[first:last]
            mean = (weight * values[first:last]).sum(axis=0) / weight.sum(axis=0)
            clear = float((mean**2 * weight.sum(axis=0)).sum())
            if clear > best[0]:
                best = (clear, first, last, mean)
    return best[1], best[2], best[3]
