"""Speeds, bends and strains of all times of a clip, from its states."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.solvers.dynamics.kernels.contact import set_rates
from ropefit.solvers.dynamics.kernels.rates import set_bends, set_strains
from ropefit.solvers.kernels.jit import copy_rows, helper, maker


class Histories(NamedTuple):
    """Speeds (T, N+1, 3), Darboux quaternions (T, N+1, 4) and strains (T, N, 3) of all times, and
    scratch: rate (N+1, 3), frame (3, 3)."""

    v: np.ndarray
    p: np.ndarray
    strain: np.ndarray
    rate: np.ndarray
    frame: np.ndarray


@maker
def make_histories(steps, n):
    """Return histories to be filled."""
    return Histories(
        np.zeros((steps, n + 1, 3)), np.zeros((steps, n + 1, 4)), np.zeros((steps, n, 3)),
        np.zeros((n + 1, 3)), np.zeros((3, 3)),
    )  # fmt: skip


@maker
def histories_of(h, k):
    """Return the histories of clip k of C."""
    return Histories(h.v[k], h.p[k], h.strain[k], h.rate[k], h.frame[k])


@helper
def set_histories(rod, drive, xs, qs, v0, h):
    """Write the histories of a clip."""
    steps, n = qs.shape[0], qs.shape[1]
    v, rate = h.v, h.rate
    copy_rows(v0, v[0])
    for t in range(1, steps):
        set_rates(rod, drive.time, xs, t, rate)
        for k in range(n + 1):
            for a in range(3):
                v[t, k, a] = rate[k, 0] * xs[t, k, a] + rate[k, 1] * xs[t - 1, k, a]
                if t > 1:
                    v[t, k, a] += rate[k, 2] * xs[t - 2, k, a]
    for t in range(steps):
        set_bends(rod, drive.clamp[t], qs[t], h.p[t])
        set_strains(rod, xs[t], qs[t], h.frame, h.strain[t])
