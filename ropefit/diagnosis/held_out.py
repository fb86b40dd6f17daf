"""Cross-validation: how well a model predicts blocks of data that it was not fitted to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import ndtr

from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.inference.bins import Stations, aligned
from ropefit.inference.least_squares import Fit, inside

BLOCKS = 5
FURTHEST_STEP = 3.0  # search variables: how far a fit to the other blocks goes
LEAST_DRAWN = 20  # residuals whose distribution is looked at
FAR_AWAY = 10.0  # m: how far off a motion is that cannot be simulated


def by_stretches(fitted: Fit) -> bool:
    """Return whether stretches of the rope are held out for a model, instead of frames: of shapes
    at rest, as a motion's clips are."""
    return fitted.forward.instantaneous and any(
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

    The values that a fit to the others has are those of first order around the fit to all data. At
    rest so is the residual: z_b + J_b (H - J_bᵀJ_b)⁻¹ J_bᵀ z_b; a motion is simulated with them.
    What the others do not determine (the values of a law where only this block is) stays as near
    as a broad prior holds it (ridge), and what is at a bound stays there. Frames at the edge of
    stability are neither fitted nor predicted: zero.
    """
    return _predicted(fitted, along)[0]


def held_out_pit(fitted: Fit, along: bool) -> np.ndarray:
    """Return (N,) the probability integral transform of residuals in their blocks' predictive
    distributions: uniform where noise and uncertainty are honest (Gneiting 2007).

    Where neighbouring residuals are missed alike, each is whitened as a part of one independent
    sample only: its own variance is so much less, and N so many fewer residuals are drawn.
    """
    residual, variance = _predicted(fitted, along)
    alike = max(fitted.problem.noise.repeats, 1.0)
    place = ndtr(residual / np.sqrt(variance - 1 + 1 / alike))
    if alike == 1:
        return place
    count = max(round(len(place) / alike), min(LEAST_DRAWN, len(place)))
    return place[np.sort(np.random.default_rng(0).permutation(len(place))[:count])]


def firm_rows(*fits: Fit) -> np.ndarray:
    """Return (M D,) bool: the rows of frames that none of some fits of the same data has at the
    edge of stability, where no prediction of first order holds; of motions all."""
    return np.logical_and.reduce([_firm(fitted) for fitted in fits])


def _firm(fitted: Fit) -> np.ndarray:
    if fitted.firm is None:
        s, instantaneous = fitted.stations, fitted.forward.instantaneous
        edge = on_edge(fitted) if instantaneous else np.zeros(len(fitted.point.seen), dtype=bool)
        fitted.firm = np.repeat(~edge[s.frame], s.residual.shape[1])
    return fitted.firm


def _predicted(fitted: Fit, along: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the predicted residuals (M D,) and their variances (M D,), noise included."""
    if along not in fitted.held_out:
        fitted.held_out[along] = _computed(fitted, along)
    return fitted.held_out[along]


def _computed(fitted: Fit, along: bool) -> tuple[np.ndarray, np.ndarray]:
    firm = _firm(fitted)
    jacobian = fitted.jacobian * inside(fitted) * firm[:, None]
    whole = jacobian.T @ jacobian + fitted.prior.information
    whole += np.eye(len(whole)) / FURTHEST_STEP**2
    block = block_of_rows(fitted, along)
    residual, variance = np.empty_like(fitted.z), np.empty_like(fitted.z)
    for b in range(BLOCKS):
        mine = block == b
        j, z = jacobian[mine], (fitted.z * firm)[mine]
        rest = np.linalg.pinv(whole - j.T @ j, hermitian=True)
        residual[mine] = z + j @ (rest @ (j.T @ z))
        if not fitted.forward.instantaneous:
            residual[mine] = _simulated(fitted, rest @ (j.T @ z), mine)
        variance[mine] = 1 + np.maximum(((j @ rest) * j).sum(axis=1), 0.0)
    return residual, variance


def _simulated(fitted: Fit, change: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """Return the whitened residual of some rows (M D,) bool, simulated with values (P,) changed."""
    (low, high), s = fitted.forward.bounds(), fitted.stations
    frames = np.unique(np.repeat(s.frame, s.residual.shape[1])[mine])
    clips = [c for c in fitted.forward.clips if np.isin(c, frames).any()]
    forward = replace(fitted.forward, clips=clips)
    point = forward.at(np.clip(fitted.point.u - change, low, high))
    lost = np.nan_to_num(fitted.point.seen) + FAR_AWAY
    now = fitted.problem.match(np.where(np.isnan(point.seen), lost, point.seen))
    return fitted.whitener(aligned(now, s, now.residual))[mine]


def block_losses(fitted: Fit, along: bool, rows: np.ndarray) -> np.ndarray:
    """Return (BLOCKS,) half the squared predicted residual of each block, in some rows (M D,)."""
    z, block = predicted(fitted, along) * rows, block_of_rows(fitted, along)
    return np.array([0.5 * float(z[block == b] @ z[block == b]) for b in range(BLOCKS)])


def weighted_error(fitted: Fit, along: bool = False) -> float:
    """Return the rms of the predicted residuals, each in units of its noise."""
    return float(np.sqrt((predicted(fitted, along) ** 2).mean()))


def heldout_rms(
    fitted: Fit, along: bool = False, rows: np.ndarray | float = 1.0
) -> tuple[float, float]:
    """Return the predicted rms distance of the points from the model, and a point's noise [m].

    rows (M D,): which residuals count, the others as none.

    The scatter within stations is noise and not counted twice. No rope is further off than it is
    long: a prediction of first order may be, where the model is next to unstable.
    """
    s, length = fitted.stations, float(fitted.point.setup.properties.length.sum())
    residual = fitted.whitener.undo(predicted(fitted, along) * rows).reshape(s.residual.shape)
    residual = np.clip(residual, -length, length)
    white = s.scatter.mean(axis=0)
    noise = float(np.sqrt(white.sum()))
    if not white.any():  # markers: theirs alone, without what the ends do to all of them
        known = fitted.problem.noise
        share = np.ones(1) if known.unequal is None else np.array(known.unequal)[s.frame]
        noise = known.marker * float(np.sqrt(white.size * share.mean()))
    return points_rms(s, residual), noise


def points_rms(s: Stations, residual: np.ndarray) -> float:
    """Return the rms distance [m] of points from a model, from the residual (M, D) [m] of their
    stations."""
    white = s.scatter.mean(axis=0)
    if not white.any():
        return float(np.sqrt((residual**2).sum(axis=1).mean()))
    weight = s.count[:, None] / s.count.sum()  # by points, as if each were compared by itself
    extra = (weight * (residual**2 - np.diagonal(s.white(), axis1=1, axis2=2))).sum(axis=0)
    return float(np.sqrt(max(white.sum() + extra.sum(), 0.0)))
