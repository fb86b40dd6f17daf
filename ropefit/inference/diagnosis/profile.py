"""Where along the rope an effect of a stretch acts, from a fit of its size stretch by stretch.

A scan sees one stretch at a time, from a rope that is bent wrongly as long as the effect is left
out; where that is much, the best of them is not where the effect is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.inference.bins import Data
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.diagnosis.weigh import BROAD
from ropefit.inference.least_squares import Fit, attempted
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward

STRETCHES = 10
SMALL = 0.3  # usual sizes


def profile(smaller: Fit, family: Family, data: Data, noise: Noise, bins: int) -> np.ndarray | None:
    """Sizes, centre and width (k + 2,) in SI of the stretch over which the family's size, fitted in
    each of `STRETCHES` at once on top of a model, is most clearly other than zero and alike. None
    where that fit fails."""
    setup = smaller.forward.base
    length = float(setup.properties.length.sum())
    width = length / STRETCHES
    centres = (np.arange(STRETCHES) + 0.5) * width
    zero = np.zeros(family.size)
    terms = []
    for centre in centres:
        term = family.term(setup, np.array([*zero, centre, width]), free_place=False)
        terms.append(replace(term, prior=BROAD * term.scale))
    forward = Forward(setup, [*smaller.forward.terms, *terms], smaller.point.solution)
    own = STRETCHES * family.size
    small = 0.0 if family.effect.linear else SMALL  # at zero some have no slope
    begin = np.concatenate([smaller.point.u, np.full(own, small)])
    found = attempted(forward, data, noise, bins, begin, 15, tolerance=1e-4)
    if found is None:
        return None
    scale = np.tile(terms[0].scale, STRETCHES)
    values = (scale * found.point.u[-own:]).reshape(STRETCHES, family.size)
    precision = 1 / (scale * found.sd()[-own:]).reshape(STRETCHES, family.size) ** 2
    first, last, sizes = _clearest(values, precision)
    return np.array([*sizes, (first + last) / 2 * width, (last - first) * width])


def _clearest(values: np.ndarray, precision: np.ndarray) -> tuple[int, int, np.ndarray]:
    """Of values (B, k) the stretch first..last - 1 whose weighted mean (k,) is the most standard
    errors from zero, and that mean."""
    best = (-np.inf, 0, 1, values[0])
    for first in range(len(values)):
        for last in range(first + 1, len(values) + 1):
            weight = precision[first:last]
            mean = (weight * values[first:last]).sum(axis=0) / weight.sum(axis=0)
            clear = float((mean**2 * weight.sum(axis=0)).sum())
            if clear > best[0]:
                best = (clear, first, last, mean)
    return best[1], best[2], best[3]
