"""The air's resistance to each node in one step, where its coefficient depends on the speed.

The coefficient is that of the speed extrapolated from the two steps before: second order in time,
like the rates, and a step stays linear in what it looks for. The logarithm of the coefficient over
`air` is piecewise linear in that of the speed, its values at whole octaves (`rod/fields.py`).
"""

from __future__ import annotations

import math

from ropefit.rod.fields import OCTAVES
from ropefit.solvers.kernels.jit import helper

FIRST, OCTAVE = float(OCTAVES[0]), math.log(2.0)


@helper
def set_resistance(rod, ratio, one, two, w):
    """Write the resistance of the nodes, from their speeds one and two steps before (N+1, 3).

    ratio: of this step to the one before, by which the speed is extrapolated. `w.drag` receives
    what the derivatives need: the factor on `air`, the knot below, the weight of the knot above,
    and d ln(factor) over the product of the speed and its change.
    """
    last = rod.drag.shape[0] - 1
    for k in range(one.shape[0]):
        square = 0.0
        for a in range(3):
            w.ahead[k, a] = one[k, a] + ratio * (one[k, a] - two[k, a])
            square += w.ahead[k, a] ** 2
        octave = 0.5 * math.log2(square) - FIRST if square > 0.0 else 0.0
        knot, above, slope = 0, 0.0, 0.0
        if octave >= last:
            knot, above = last - 1, 1.0
        elif octave > 0.0:
            knot = int(octave)
            above = octave - knot
            slope = (rod.drag[knot + 1] - rod.drag[knot]) / (OCTAVE * square)
        factor = math.exp((1 - above) * rod.drag[knot] + above * rod.drag[knot + 1])
        w.air[k] = rod.air[k] * factor
        w.drag[k, 0], w.drag[k, 1], w.drag[k, 2], w.drag[k, 3] = factor, knot, above, slope
