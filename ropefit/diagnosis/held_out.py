"""Cross-validation: how well a model predicts blocks of data that it was not fitted to."""

from __future__ import annotations

import numpy as np

from ropefit.inference.least_squares import Fit

BLOCKS = 5


def by_stretches(fitted: Fit) -> bool:
    """Return whether stretches of the rope are held out for a model, instead of frames."""
    return any(
        t.effect is not None and t.effect.held_out == "stretches" for t in fitted.forward.terms
    )


def block_of_rows(fitted: Fit, along: bool) -> np.ndarray:
    """Return (M D,) the block of each whitened row: of neighbouring frames, or of every fifth
    station along the rope."""
    s, frames = fitted.stations, len(fitted.point.seen)
    block = s.bin % BLOCKS if along else fitted.forward.folds(frames, BLOCKS)[s.frame]
    return np.repeat(block, s.residual.shape[1])


def predicted(fitted: Fit, along: bool = False) -> np.ndarray:
    """Return (M D,) the whitened residual of each block as predicted by a fit to the others.

    To first order around the fit to all data: z_b + J_b (H - J_bᵀJ_b)⁻¹ J_bᵀ z_b.
    """
    held = np.isfinite(fitted.prior)
    whole = fitted.jacobian.T @ fitted.jacobian + np.diag(np.where(held, 1 / fitted.prior**2, 0.0))
    block, out = block_of_rows(fitted, along), np.empty_like(fitted.z)
    for b in range(BLOCKS):
        mine = block == b
        j, z = fitted.jacobian[mine], fitted.z[mine]
        rest = np.linalg.pinv(whole - j.T @ j, rcond=1e-12, hermitian=True)
        out[mine] = z + j @ (rest @ (j.T @ z))
    return out


def block_losses(fitted: Fit, along: bool) -> np.ndarray:
    """Return (BLOCKS,) half the squared predicted residual of each block."""
    z, block = predicted(fitted, along), block_of_rows(fitted, along)
    return np.array([0.5 * float(z[block == b] @ z[block == b]) for b in range(BLOCKS)])


def heldout_rms(fitted: Fit, along: bool = False) -> tuple[float, float]:
    """Return the predicted rms distance of the points from the model, and a point's noise [m].

    The scatter within stations is noise and not counted twice.
    """
    s = fitted.stations
    residual = fitted.whitener.undo(predicted(fitted, along)).reshape(s.residual.shape)
    white = s.scatter.mean(axis=0)
    if not white.any():  # markers: their noise is in the whitener
        repeats = fitted.problem.noise.repeats
        noise = float(np.sqrt(fitted.whitener.variance() * 3 / repeats))
        return float(np.sqrt((residual**2).sum(axis=1).mean())), noise
    weight = s.count[:, None] / s.count.sum()  # by points, as if each were compared by itself
    extra = (weight * (residual**2 - np.diagonal(s.white(), axis1=1, axis2=2))).sum(axis=0)
    noise = float(np.sqrt(white.sum()))
    return float(np.sqrt(max(white.sum() + extra.sum(), 0.0))), noise
