"""Frames that a fit left on the wrong one of two equilibria, detected by their residual."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.inference.bins import Data, match
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward
from ropefit.solvers.equilibrium.solution import States

SUSPECT_RATIO = 4.0  # of a frame's residual to the median one
GAIN_RATIO = 0.7  # of the misfit on another branch to that before
EVALUATIONS = 20


def on_right_branches(fitted: Fit, data: Data, noise: Noise, bins: int) -> Fit:
    """Bring frames on the wrong branch to the right one and refit; the same fit if none gains."""
    states = repaired(fitted, data, bins)
    if states is None:
        return fitted
    forward = Forward(fitted.forward.base, fitted.forward.terms, states)
    again = fit(forward, data, noise, bins, fitted.point.u, EVALUATIONS, tolerance=1e-5)
    return again if again.cost < fitted.cost else fitted


def repaired(fitted: Fit, data: Data, bins: int) -> States | None:
    """Return states in which such frames are settled from their neighbours', None if none gains."""
    point, frame = fitted.point, fitted.stations.frame
    if point.setup.remembers:  # each frame's states follow from the ones before
        return None
    z = fitted.z.reshape(len(frame), -1)
    frames = len(point.seen)
    size = np.array(
        [np.sqrt((z[frame == t] ** 2).mean()) if (frame == t).any() else 0.0 for t in range(frames)]
    )
    far = np.flatnonzero(size > SUSPECT_RATIO * max(float(np.median(size)), 1.0))
    if len(far) == 0 or len(far) > frames // 3:
        return None
    out, gained = point.solution.states, False
    for t in far:
        best = _misfit(data, point.seen, int(t), int(t), bins)
        for near in (t - 1, t + 1):
            if not 0 <= near < frames or near in far:
                continue
            start = point.solution.frames(np.array([near]))
            few = point.setup.frames(torch.tensor([int(t)]))
            there = Forward(few, []).at(np.empty(0), start)
            if not there.solution.converged.all():
                continue
            now = _misfit(data, there.seen, int(t), 0, bins)
            if now < GAIN_RATIO * best:
                best, gained = now, True
                out.put(int(t), there.solution, 0)
    return out if gained else None


def _misfit(data: Data, seen: np.ndarray, frame: int, row: int, bins: int) -> float:
    s = match(data.frames(np.array([frame])), seen[row : row + 1], bins)
    return float(np.median(np.abs(s.residual))) if len(s.frame) else np.inf
