"""Frames that a fit left on the wrong one of two equilibria, detected by their residual."""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.problem import FitProblem
from ropefit.inference.starts import cheaper
from ropefit.solvers.equilibrium.branches import other_states
from ropefit.solvers.equilibrium.solution import States

SUSPECT_RATIO = 3.0  # of a frame's residual to the median one
GAIN_RATIO = 0.7  # of the misfit on another branch to that before
EVALUATIONS = 20


def on_right_branches(fitted: Fit) -> Fit:
    """Bring frames on the wrong branch to the right one and refit; the same fit if none gains."""
    states = repaired(fitted)
    if states is None:
        return fitted
    forward = fitted.forward.with_terms(fitted.forward.terms, states)
    again = fit(forward, fitted.problem, fitted.point.u, EVALUATIONS, tolerance=1e-5)
    return cheaper(fitted, again)


def repaired(fitted: Fit) -> States | None:
    """Return states in which such frames are settled from their neighbours', or in their other
    equilibrium; None if none gains."""
    point, frame = fitted.point, fitted.stations.frame
    if point.setup.remembers or not fitted.forward.instantaneous:
        # Each frame's states follow from the ones before.
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
    others, apart = other_states(point.solution.frames(far))
    for k, t in enumerate(far):
        best = _misfit(fitted.problem, point.seen, int(t), int(t))
        starts = [
            point.solution.frames(np.array([near]))
            for near in (t - 1, t + 1)
            if 0 <= near < frames and near not in far
        ]
        if np.isfinite(apart[k]):  # frames may be in any order
            starts.append(others.frames(np.array([k])))
        for start in starts:
            few = point.setup.frames(np.array([t]))
            there = fitted.forward.of_setup(few).at(np.empty(0), start)
            if not there.converged.all():
                continue
            now = _misfit(fitted.problem, there.seen, int(t), 0)
            if now < GAIN_RATIO * best:
                best, gained = now, True
                out.put(int(t), there.solution, 0)
    return out if gained else None


def _misfit(problem: FitProblem, seen: np.ndarray, frame: int, row: int) -> float:
    s = problem.frames(np.array([frame])).match(seen[row : row + 1])
    return float(np.median(np.linalg.norm(s.residual, axis=1))) if len(s.frame) else np.inf
