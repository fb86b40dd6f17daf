"""The smallest eigenvalue of an equilibrium's energy."""

from __future__ import annotations

import math

from ropefit.solvers.equilibrium.kernels.block_tridiagonal import factor_system
from ropefit.solvers.equilibrium.kernels.hessian import assemble, set_corner
from ropefit.solvers.equilibrium.kernels.state import set_state
from ropefit.solvers.kernels.jit import helper


@helper
def smallest_eigenvalue(rod, held, q, lam, x0, w):
    """Return smallest eigenvalue [N] of the energy's second derivative in the turns, weighted by
    length, along the supports: by bisection on the number of descent directions."""
    n = rod.length.shape[0]
    set_state(rod, held, q, lam, x0, w)
    assemble(rod, held, lam, w)
    set_corner(rod, held, w)
    high = 0.0
    for i in range(n):
        for a in range(3):
            high = max(high, abs(w.diagonal[i, a, a]) / rod.length[i])
    high *= 4
    if factor_system(rod, held, w, 0.0, 0.0) > 0:
        low, sign = 1e-12 * high, -1.0
        while factor_system(rod, held, w, 0.0, low) > 0 and low < 1e3 * high:
            low *= 4
        if low <= 1e-12 * high:
            return -low
        return -_bisect(rod, held, w, low / 4, low, sign)
    low = high
    while factor_system(rod, held, w, 0.0, -low) > 0 and low > 1e-14 * high:
        low /= 4
    if low >= high:
        return high
    return _bisect(rod, held, w, low, 4 * low, 1.0)


@helper
def _bisect(rod, held, w, low, high, sign):
    """Return the mass at which a direction of descent appears (sign 1) or is gone (sign -1)."""
    for _ in range(24):
        middle = math.sqrt(low * high)
        descends = factor_system(rod, held, w, 0.0, -sign * middle) > 0
        if descends == (sign > 0):
            high = middle
        else:
            low = middle
        if high < low * (1 + 1e-6):
            break
    return math.sqrt(low * high)
