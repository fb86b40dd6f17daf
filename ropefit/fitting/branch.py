"""Which of two stable equilibria the data show."""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit
from ropefit.solvers.equilibrium.branches import other_states
from ropefit.solvers.equilibrium.solution import Solution


def nearer_branch(result: Fit) -> Solution:
    """Return, of two stable states of a frame, the one that the data show."""
    point = result.point
    found, apart = other_states(point.solution)
    last = point.solution.copy()
    for t in np.flatnonzero(np.isfinite(apart)):
        one = np.array([t])
        gaps = [
            np.median(np.linalg.norm(result.problem.frames(one).match(s.x[one]).residual, axis=1))
            for s in (last, found)
        ]
        if gaps[1] < gaps[0]:
            last.put(t, found, t)
    return last
