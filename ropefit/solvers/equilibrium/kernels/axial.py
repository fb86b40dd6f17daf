"""Axial strain that is not in proportion to tension.

The strain is the axial flexibility times the tension times a factor, whose logarithm is piecewise
linear in that of the tension: `axial`, its values at PER_OCTAVE tensions in every octave
(`rod/fields.py`). Tension and compression are alike.
"""

from __future__ import annotations

import math

from ropefit.rod.fields import PER_OCTAVE, TENSION_OCTAVES
from ropefit.solvers.kernels.jit import helper

FIRST = float(TENSION_OCTAVES[0])
LOG_STEP = math.log(2.0) / PER_OCTAVE  # of the logarithm of the tension, from one value to the next


@helper
def set_stored(axial, stored):
    """Write the integral [N²] of the factor times the tension, from zero to each value's own."""
    edge, factor = 2.0**FIRST, math.exp(axial[0])
    stored[0] = 0.5 * factor * edge * edge
    for k in range(axial.shape[0] - 1):
        power = (axial[k + 1] - axial[k]) / LOG_STEP
        wider = math.exp(LOG_STEP)
        above = math.exp(axial[k + 1])
        grown = above * wider * wider - factor
        stored[k + 1] = stored[k] + edge * edge * grown / (power + 2)
        edge *= wider
        factor = above


@helper
def stretched(axial, stored, u):
    """Return the factor times the tension u [N], the derivative of that by u, and its integral."""
    size, last = abs(u), axial.shape[0] - 1
    at = (math.log2(size) - FIRST) * PER_OCTAVE if size > 0.0 else 0.0
    if at <= 0.0:
        factor = math.exp(axial[0])
        return factor * u, factor, 0.5 * factor * u * u
    knot = min(int(at), last)
    edge = 2.0 ** (FIRST + knot / PER_OCTAVE)
    power = (axial[knot + 1] - axial[knot]) / LOG_STEP if knot < last else 0.0
    factor = math.exp(axial[knot] + (at - knot) * LOG_STEP * power)
    grown = factor * size * size - math.exp(axial[knot]) * edge * edge
    return factor * u, factor * (1 + power), stored[knot] + grown / (power + 2)
