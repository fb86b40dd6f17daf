"""What a model misses beyond noise: it is no fresh error in every sample.

A shape that is missed is missed alike in neighbouring frames and along the rope. Such a residual is
worth as many samples as there are independent ones (effective sample size, Geyer 1992, in time;
participation ratio of the covariance along the rope), and so are evidence and intervals.
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.bins import Stations

LEAST_CORRELATION = 0.05  # of the residual with itself: later lags count as independent


def inflation(s: Stations, z: np.ndarray, scale: float, known: bool) -> float:
    """Return by how much the variance of estimates exceeds that by the noise alone.

    z (M D,): whitened residual of sd `scale`: 1 from noise, and what is beyond from what the model
    misses, of which several samples count as one. Below 1 noise was taken as too large, unless it
    is known from elsewhere.
    """
    beyond = scale**2 - 1
    if beyond <= 0:
        return 1.0 if known else max(scale**2, 1e-12)
    every = [np.unique(s.frame)]
    return 1 + beyond * repeats(s, z.reshape(s.residual.shape), every)


def repeats(s: Stations, residual: np.ndarray, clips: list[np.ndarray]) -> float:
    """Return of how many samples (M, D) one is independent, in time and along the rope."""
    rows = np.unique(s.frame)
    table = np.zeros((len(rows), int(s.bin.max()) + 1, residual.shape[1]))
    table[np.searchsorted(rows, s.frame), s.bin] = residual
    table = table.reshape(len(rows), -1)
    covariance, columns = table.T @ table, np.count_nonzero(table.any(0))
    alike = (covariance**2).sum() / np.trace(covariance) ** 2 * columns
    alike -= columns / len(rows)  # so much of it is chance
    parts = [table[np.isin(rows, clip)] for clip in clips]
    whole, lag, correlation = float((table**2).mean()), 1, 0.0
    while True:
        pairs = [(part[:-lag] * part[lag:]).ravel() for part in parts if len(part) > lag]
        shared = float(np.concatenate(pairs).mean()) / whole if pairs else 0.0
        if shared < LEAST_CORRELATION:
            return float(max(1 + 2 * correlation, 1.0) * max(alike, 1.0))
        correlation, lag = correlation + shared, lag + 1
