"""Frames that a fit left on the wrong one of two equilibria, found by their residual."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.inference.forward import Forward
from ropefit.inference.least_squares import Fit
from ropefit.inference.stations import Data, match
from ropefit.solvers.equilibrium.solution import States

FAR = 4.0  # times the usual residual of a frame


def repaired(found: Fit, data: Data, bins: int) -> States | None:
    """States in which such frames start from their neighbours' side, None if nothing is gained."""
    point, frame = found.point, found.stations.frame
    if point.setup.remembers:  # each frame's states follow from the ones before
        return None
    z = found.z.reshape(len(frame), -1)
    frames = len(point.seen)
    size = np.array(
        [np.sqrt((z[frame == t] ** 2).mean()) if (frame == t).any() else 0.0 for t in range(frames)]
    )
    far = np.flatnonzero(size > FAR * max(float(np.median(size)), 1.0))
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
            if now < 0.7 * best:
                best, gained = now, True
                out.put(int(t), there.solution, 0)
    return out if gained else None


def _misfit(data: Data, seen: np.ndarray, frame: int, row: int, bins: int) -> float:
    s = match(data.frames(np.array([frame])), seen[row : row + 1], bins)
    return float(np.median(np.abs(s.residual))) if len(s.frame) else np.inf
