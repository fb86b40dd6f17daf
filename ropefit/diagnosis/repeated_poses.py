"""The noise of markers at rest, as neighbouring poses repeat it: without what a model misses."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import gammaincinv

from ropefit.inference.bins import Stations
from ropefit.inference.least_squares import Fit
from ropefit.rod.setup import Setup

FEWEST_PAIRS = 10  # of stations, whose median says anything


def repeated_noise(fitted: Fit) -> float | None:
    """Return the noise of a marker [m], over all its components, from how the residuals differ
    between each pose of the ends and the one that is nearest; None where that is not known.

    What a model misses varies little between them, noise does: the median is an upper bound that a
    few poses, between which the shape snaps, do not raise. Only markers at rest have one: of other
    points the scatter is measured, and a motion's shapes depend on more than the ends.
    """
    s = fitted.stations
    if not fitted.markers_at_rest or len(fitted.point.seen) < 2:
        return None
    near = nearest_poses(fitted.point.setup)
    here, there = paired(s, near)
    if len(here) < FEWEST_PAIRS:
        return None
    apart = np.linalg.norm(s.residual[here] - s.residual[there], axis=1)
    many = s.residual.shape[1]
    median = np.sqrt(2 * gammaincinv(many / 2, 0.5))  # of a chi distribution
    return float(np.median(apart) / median * np.sqrt(many / 2))


def nearest_poses(setup: Setup) -> np.ndarray:
    """Return (F,) the other frame whose ends are nearest, in lengths and turns."""
    length = float(setup.properties.length.sum())
    ends = np.nan_to_num(setup.ends).reshape(len(setup.ends), -1) / length
    clamp = np.nan_to_num(setup.clamp)
    apart = cdist(ends, ends)
    for end in range(2):
        alike = np.abs(clamp[:, end] @ clamp[:, end].T)
        if setup.clamped[end]:
            apart += 2 * np.arccos(np.clip(alike, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return apart.argmin(axis=1)


def paired(s: Stations, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (n,) of stations, and those of the same markers in the frames that are nearest,
    near (F,)."""
    row = {key: k for k, key in enumerate(zip(s.frame.tolist(), s.bin.tolist(), strict=True))}
    pairs = [
        (k, row[near[frame], marker])
        for (frame, marker), k in row.items()
        if (near[frame], marker) in row
    ]
    here, there = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return here, there
