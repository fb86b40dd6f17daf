"""Sizes of effects that the data leave open.

Shapes at rest show only ratios of forces to the weight. A steady load along gravity does what a
heavier, stiffer rope does, and a fit ends anywhere along that valley: all other forces are then as
wrong as the weight is. Where the data tell less of a direction than the broad prior of the sizes
does, the least sizes are taken, as that prior has it (`Fit.covariance` has its width).
"""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit, attempted

OPEN = 0.5  # of the prior's variance: left open by the data
ROUNDS = 4
SHARES = (1.0, 0.5)  # of the way, until a fit there is as good
EVALUATIONS = 10
LEAST_MOVE = 0.05  # usual sizes
NO_WORSE = 3.0  # of the cost: what is open costs nothing, but each fit matches the data anew


def with_least_sizes(found: Fit) -> Fit:
    """Return the fit, moved along what the data leave open to the least sizes of its effects."""
    for _ in range(ROUNDS):
        step = _to_least_sizes(found)
        if step is None:
            break
        moved = next((f for s in SHARES if (f := _moved(found, s * step)) is not None), None)
        if moved is None:
            break
        found = moved
    return found


def _moved(found: Fit, step: np.ndarray) -> Fit | None:
    """Return the fit from a step (P,) away; None if it is worse there."""
    low, high = found.forward.bounds()
    forward = found.forward.starting_from(found.point.solution)
    begin = np.clip(found.point.u + step, low, high)
    moved = attempted(forward, found.problem, begin, EVALUATIONS, tolerance=1e-5)
    if moved is None or len(moved.z) != len(found.z) or not moved.point.converged.all():
        return None
    return moved if moved.cost < found.cost + NO_WORSE else None


def _to_least_sizes(found: Fit) -> np.ndarray | None:
    """Return the step (P,) to the least sizes, to first order; None where nothing is open."""
    broad = found.forward.broad()
    mine = np.flatnonzero(np.isfinite(broad))
    if not len(mine):
        return None
    parts = zip(found.forward.terms, found.forward.split(found.point.u), strict=True)
    sizes = np.concatenate([(t.value(u) / t.scale) for t, u in parts])[mine] / broad[mine]
    to_prior = found.covariance[:, mine] / broad[mine]
    share, directions = np.linalg.eigh(to_prior[mine] / broad[mine, None])
    left_open = directions[:, share > OPEN]
    away = left_open.T @ sizes
    if np.linalg.norm(away) * float(broad[mine].max()) < LEAST_MOVE:
        return None
    return -to_prior @ (left_open @ away)
