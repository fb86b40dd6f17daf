"""Speeds, bends and strains of all times of a clip, from its states."""

from __future__ import annotations

import numpy as np

from ropefit.solvers.dynamics.kernels.contact import set_rates
from ropefit.solvers.dynamics.kernels.rates import set_bends, set_strains
from ropefit.solvers.kernels.jit import copy_rows, maker


@maker
def histories(rod, drive, xs, qs, v0, r):
    """Return speeds (T, N+1, 3), Darboux quaternions (T, N+1, 4) and strains (T, N, 3) of all
    times."""
    steps, n = qs.shape[0], qs.shape[1]
    v, p = np.zeros((steps, n + 1, 3)), np.zeros((steps, n + 1, 4))
    strain = np.zeros((steps, n, 3))
    copy_rows(v0, v[0])
    rate = np.zeros((n + 1, 3))
    for t in range(1, steps):
        set_rates(rod, drive.time, xs, t, rate)
        for k in range(n + 1):
            for a in range(3):
                v[t, k, a] = rate[k, 0] * xs[t, k, a] + rate[k, 1] * xs[t - 1, k, a]
                if t > 1:
                    v[t, k, a] += rate[k, 2] * xs[t - 2, k, a]
    for t in range(steps):
        set_bends(rod, drive.clamp[t], qs[t], p[t])
        set_strains(rod, xs[t], qs[t], r, strain[t])
    return v, p, strain
