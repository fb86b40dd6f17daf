"""Steps towards the least sum of squares: the linear one, and those along a narrow, curved valley.

Where parameters can stand for each other (a weight, and the rigidity and rest shape of the rope
that it bends) the least cost lies along a curve. A straight step leaves it unless it is short, and
a trust region shrinks until steps gain next to nothing, far from the minimum. A step that bends as
the curve does stays inside: the method of Levenberg and Marquardt with geodesic acceleration
(Transtrum and Sethna, arXiv 1201.5885).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import optimize

from ropefit.models.prior import Prior

FURTHEST_STEP = 100.0  # search variables
AHEAD = 0.1  # of a step: where its second derivative is measured
MOST_BENT = 0.4  # of a step: the most by which the second derivative may bend it
DAMPING, LEAST_DAMPING = 1e-3, 1e-5  # of each direction: the first, and the least
CHANGE = 10.0  # by how much it grows where a step fails, and shrinks where one gains
MOST_FAILED = 5  # steps in a row

Function = Callable[[np.ndarray], np.ndarray]


def linear_step(
    slopes: np.ndarray, rows: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the best linear step (P,) for the sum of squares of rows (M,), whose derivatives are
    slopes (M, P), between its bounds low and high (P,), and by how much it lowers that sum."""
    # Not by the normal equations: from a bad start singular values of the slopes span 1e9.
    q, r = np.linalg.qr(np.concatenate([slopes, np.eye(len(low)) / FURTHEST_STEP]))
    within = low, np.maximum(high, low + np.finfo(float).eps)
    step = optimize.lsq_linear(r, -(q[: len(rows)].T @ rows), within).x
    left = rows + slopes @ step
    return step, max(float(rows @ rows - left @ left), 0.0)


def with_priors(jacobian: np.ndarray, prior: Prior) -> np.ndarray:
    """Return the slopes of the residual rows of a prediction's Jacobian (M, P), those of priors
    last."""
    return np.concatenate([-jacobian, prior.factor])


def foreseen(
    rows: np.ndarray, slopes: np.ndarray, u: np.ndarray, low: np.ndarray, high: np.ndarray
) -> float:
    """Return by how much the best linear step from u (P,) lowers the sum of squares, in units in
    which the noise adds one for each of the rows (M,)."""
    if not u.size:
        return 0.0
    scale = max(1.0, float(rows @ rows) / max(len(rows) - len(u), 1))
    return linear_step(slopes, rows, low - u, high - u)[1] / scale


def along_valley(
    rows: Function, slopes: Function, u: np.ndarray, low: np.ndarray, high: np.ndarray,
    enough: float, evaluations: int,
) -> np.ndarray:  # fmt: skip
    """Return (P,) from where a linear step gains less than `enough`, between low and high (P,), or
    where some evaluations lead, from u; rows (M,) and their slopes (M, P) as functions of it."""
    z, slope, damping = rows(u), slopes(u), DAMPING
    scale, failed, count = np.zeros(len(u)), 0, 0
    while count < evaluations and failed < MOST_FAILED:
        scale = np.maximum(scale, np.linalg.norm(slope, axis=0))
        damped = np.concatenate([slope, np.diag(np.sqrt(damping) * np.maximum(scale, 1e-12))])
        step, inverse = _within(damped, z, low - u, high - u)
        ahead, count = rows(u + AHEAD * step), count + 1
        bend = -inverse @ ((ahead - z) / AHEAD - slope @ step) / AHEAD
        trial = np.clip(u + step + bend, low, high)
        near = np.linalg.norm(scale * bend) < MOST_BENT * np.linalg.norm(scale * step)
        new = rows(trial) if near else ahead
        count += near
        if not (near and new @ new < z @ z):
            damping, failed = damping * CHANGE, failed + 1
            continue
        u, z, slope, failed = trial, new, slopes(trial), 0
        damping = max(damping / CHANGE, LEAST_DAMPING)
        if foreseen(z, slope, u, low, high) < enough:
            break
    return u


def _within(
    damped: np.ndarray, z: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the damped linear step (P,) between low and high (P,) for rows z (M,), and the matrix
    (P, M) that maps -z to a free step: zero in the rows of what is held at a bound.

    damped (M + P, P): slopes of the rows and of the damping. What would cross its bound is held
    there, and the others are solved for again without it.
    """
    step, held = np.zeros(len(low)), np.zeros(len(low), dtype=bool)
    while True:
        free = np.flatnonzero(~held)
        inverse = np.zeros((len(low), len(z)))
        inverse[free] = np.linalg.pinv(damped[:, free])[:, : len(z)]
        step[free] = -inverse[free] @ (z + damped[: len(z), held] @ step[held])
        beyond = ~held & ((step < low) | (step > high))
        if not beyond.any():
            return step, inverse
        step[beyond] = np.clip(step, low, high)[beyond]
        held |= beyond
