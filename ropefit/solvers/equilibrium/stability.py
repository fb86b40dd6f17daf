"""Whether an equilibrium is stable, and by how much."""

from __future__ import annotations

import numpy as np

from ropefit.solvers.arrays import in_threads
from ropefit.solvers.equilibrium.kernels.entries import stability_ropes
from ropefit.solvers.equilibrium.problem import cut
from ropefit.solvers.equilibrium.solution import Solution


def stability(solution: Solution) -> np.ndarray:
    """Return the smallest eigenvalue (F,) [N] of the energy's second derivative in the turns of the
    segments (per length), along what the supports allow. Positive: stable.

    The spin of a rope whose ends hold no twist costs nothing: segment 0 is held against it, so that
    a small twist rigidity may set the value.
    """
    problem, out = solution.problem, np.empty(len(solution.q))

    def work(index: slice) -> None:
        stability_ropes(
            *cut(problem, index), solution.q[index], solution.reaction[index],
            solution.base[index], out[index],
        )  # fmt: skip

    in_threads(work, len(out))
    return out
