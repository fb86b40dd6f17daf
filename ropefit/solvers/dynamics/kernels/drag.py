"""The air's resistance to each node in one step, where its coefficient depends on the speed.

The coefficient is that of the speed extrapolated from the two steps before: second order in time,
like the rates, and a step stays linear in what it looks for. The logarithm of the coefficient over
`air` is piecewise linear in that of the speed, its values at whole octaves (`rod/fields.py`).
"""

from __future__ import annotations

import math

from ropefit.rod.fields import OCTAVES
from ropefit.solvers.kernels.jit import helper

FIRST = float(OCTAVES[0])
SQUARE = 2.0 / math.log(2.0)  # octaves of a squared speed are half those of the speed


@helper
def steps_ahead(time, t):
    """Return a step's length over that of the one before; zero for the first."""
    return 0.0 if t < 2 else (time[t] - time[t - 1]) / (time[t - 1] - time[t - 2])


@helper
def set_resistance(rod, ahead, one, two, w):
    """Write the resistance of the nodes, from their speeds one and two steps before (N+1, 3).

    ahead: see `steps_ahead`. What the derivatives need goes into `w.drag`: the factor on `air`, the
    knot below, the weight of the knot above, and d ln(factor) over the speed and its change.
    """
    last = rod.drag.shape[0] - 1
    for k in range(one.shape[0]):
        square = 0.0
        for a in range(3):
            w.ahead[k, a] = one[k, a] + ahead * (one[k, a] - two[k, a])
            square += w.ahead[k, a] ** 2
        octave = 0.5 * math.log2(square) - FIRST if square > 0.0 else 0.0
        knot, above, slope = 0, 0.0, 0.0
        if octave >= last:
            knot, above = last - 1, 1.0
        elif octave > 0.0:
            knot = int(octave)
            above = octave - knot
            slope = 0.5 * SQUARE * (rod.drag[knot + 1] - rod.drag[knot]) / square
        factor = math.exp((1 - above) * rod.drag[knot] + above * rod.drag[knot + 1])
        w.air[k] = rod.air[k] * factor
        w.drag[k, 0], w.drag[k, 1], w.drag[k, 2], w.drag[k, 3] = factor, knot, above, slope
