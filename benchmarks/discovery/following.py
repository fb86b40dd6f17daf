"""Shapes that follow from frame to frame, as those of a rope that is moved slowly do.

Each frame is solved from the rope without an effect. Where the effect is large, that may end in
another equilibrium than in the neighbouring frames: mostly in one that no rope stays in.
"""

from __future__ import annotations

import numpy as np

from reference_simulators.collocation import NotConverged, solve
from reference_simulators.kirchhoff_rod import RodProblem
from reference_simulators.rod_equations import Array

JUMP = 5.0  # times the usual change of what an effect does, from frame to frame
LEAST = 0.002  # m


def followed(problem: RodProblem, plain: Array, states: Array) -> Array:
    """Return states (T, N + 1, 13) in which what was changed about `plain` changes gradually.

    The longest stretch of frames without a jump is kept, the others are solved anew from their
    neighbours; where that does not converge, a frame stays as it was.
    """
    out, change = states.copy(), states - plain
    step = np.linalg.norm(np.diff(change[..., :3], axis=0), axis=-1).max(axis=1)
    jumps = np.flatnonzero(step > max(JUMP * float(np.median(step)), LEAST))
    if not len(jumps):
        return states
    parts = np.split(np.arange(len(states)), jumps + 1)
    longest = max(parts, key=len)
    ways = [(t, t - 1) for t in range(longest[-1] + 1, len(states))]
    ways += [(t, t + 1) for t in range(longest[0] - 1, -1, -1)]
    for frame, neighbour in ways:
        begin = out.copy()
        begin[frame] = plain[frame] + out[neighbour] - plain[neighbour]
        try:
            out[frame] = solve(problem, begin, most=40)[frame]
        except (NotConverged, np.linalg.LinAlgError):
            continue
    return out
