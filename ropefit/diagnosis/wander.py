"""How many samples of a motion's residual count as one.

What an open-loop motion misses wanders for a swing or so, and neighbouring markers miss it alike:
thousands of samples are worth as many as there are independent ones (effective sample size, Geyer
1992, in time; participation ratio of the covariance along the rope).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.scan import Projection
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.bins import Stations
from ropefit.inference.least_squares import Fit
from ropefit.inference.noise import Noise

MESH_ERROR = 5e-4  # of the length: by which ropes of other meshes, steps and solvers differ
LEAST_CORRELATION = 0.05  # of the residual with itself: later lags count as independent


def wandering_noise(fitted: Fit, sensitivities: list[Sensitivity]) -> Noise:
    """Return the noise of markers, with the repeats that one independent sample has.

    Both are those of what the best single effect leaves, at its best place and to first order: a
    mismatch with a cause is no noise. All effects at once would explain noise as well: a few swings
    are fewer samples than there are effects and places.
    """
    left = _left_by_the_best(fitted, sensitivities)
    residual = fitted.whitener.undo(left).reshape(fitted.stations.residual.shape)
    marker = float(np.sqrt((residual**2).mean()))
    clips = getattr(fitted.forward, "clips", [])
    # What the mesh misses is the same in all frames of a clip and along much of the rope.
    length = float(fitted.point.setup.properties.length.sum())
    alike = len(residual) / max(len(clips), 1)
    mesh = alike * (MESH_ERROR * length / marker) ** 2
    many = max(repeats(fitted.stations, residual, clips), 1 + mesh)
    return replace(fitted.problem.noise, marker=marker, repeats=many)


def _left_by_the_best(fitted: Fit, sensitivities: list[Sensitivity]) -> np.ndarray:
    """Return (M D,) the whitened residual beside the effect that explains most of it."""
    project = Projection(fitted)
    best, most = project.z, 0.0
    for one in sensitivities:
        kept = project(one.values)
        for place in range(kept.shape[1]):
            columns = kept[:, place]
            sizes = np.linalg.lstsq(columns, project.z, rcond=1e-6)[0]
            gain = float(project.z @ columns @ sizes)
            if gain > most:
                best, most = project.z - columns @ sizes, gain
    return best


def repeats(s: Stations, residual: np.ndarray, clips: list[np.ndarray]) -> float:
    """Return of how many samples (M, D) one is independent, in time and along the rope."""
    rows = np.unique(s.frame)
    table = np.zeros((len(rows), int(s.bin.max()) + 1, residual.shape[1]))
    table[np.searchsorted(rows, s.frame), s.bin] = residual
    table = table.reshape(len(rows), -1)
    covariance = table.T @ table
    alike = (covariance**2).sum() / np.trace(covariance) ** 2 * np.count_nonzero(table.any(0))
    parts = [table[np.isin(rows, clip)] for clip in clips]
    whole, lag, correlation = float((table**2).mean()), 1, 0.0
    while True:
        pairs = [(part[:-lag] * part[lag:]).ravel() for part in parts if len(part) > lag]
        shared = float(np.concatenate(pairs).mean()) / whole if pairs else 0.0
        if shared < LEAST_CORRELATION:
            return float(max(1 + 2 * correlation, 1.0) * max(alike, 1.0))
        correlation, lag = correlation + shared, lag + 1
