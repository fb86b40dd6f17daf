"""Intervals by the sandwich covariance: of clusters for the paper's losses, of blocks of time for
motions.

The losses are sums of norms. With J the derivative of the residual vectors r_i, the curvature A of
the loss is that of the smoothed norm sqrt(r² + floor²): Σ J_iᵀ (1 - r_i r_iᵀ/ρ²) J_i / ρ with
ρ² = r_i² + floor² (in one dimension this is a kernel estimate of the density at the kink, as in
median regression). The score by cluster (a frame, a segment) is s_c = Σ J_iᵀ r_i/|r_i|. Points of
one cluster are not independent, so the covariance is A⁻¹ (Σ s_c s_cᵀ) A⁻¹ · C/(C-n) with C clusters
(Huber 1967; Liang & Zeger 1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ropefit.inference.intervals import Estimates, condition_of, correlation_of, estimate
from ropefit.inference.least_squares import Fit
from ropefit.inference.verdict import partners

NULL = 1e-9  # eigenvalue of the scaled curvature under which a direction counts as undetermined
SHARED = 1e-3  # of a direction's square: a parameter that has as much is part of it
BLOCK = 0.5  # s: residuals of a motion that are further apart count as independent


@dataclass(frozen=True)
class Uncertainty:
    """Of n parameters: sd (n,), inf where undetermined; correlation (n, n); condition number."""

    sd: np.ndarray
    half_width: np.ndarray  # of the 95 % interval
    correlation: np.ndarray
    condition: float
    dead: np.ndarray
    null: np.ndarray  # (n, m) directions the data do not determine


def sandwich(
    jacobian: np.ndarray, residual: np.ndarray, cluster: np.ndarray, floor: float, dead_below: float
) -> Uncertainty:
    """Return uncertainty of the minimiser of Σ|r_i|.

    jacobian (M, D, n), residual (M, D), cluster (M,) labels, floor: noise scale in units of r. A
    parameter whose column has an rms under `dead_below` does nothing.
    """
    n = jacobian.shape[2]
    norm = np.linalg.norm(residual, axis=1)
    smooth = np.sqrt(norm**2 + max(floor, 1e-150) ** 2)
    along = np.einsum("mdi,md->mi", jacobian, residual) / smooth[:, None]
    curvature = np.einsum("mdi,mdj,m->ij", jacobian, jacobian, 1 / smooth)
    curvature -= np.einsum("mi,mj,m->ij", along, along, 1 / smooth)
    direction = residual * np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 0.0)[:, None]
    scores = np.einsum("mdi,md->mi", jacobian, direction)
    labels, index = np.unique(cluster, return_inverse=True)
    summed = np.zeros((labels.size, n))
    np.add.at(summed, index, scores)
    summed -= summed.mean(axis=0)

    rms = np.sqrt((jacobian**2).sum(axis=1).mean(axis=0))
    dead = ~(rms > dead_below)
    scale = np.where(dead, 1.0, 1.0 / np.sqrt(np.maximum(np.diag(curvature), 1e-300)))
    scaled = curvature * np.outer(scale, scale)
    scaled[dead] = scaled[:, dead] = 0.0
    values, vectors = np.linalg.eigh(scaled)
    known = values > NULL * max(values.max(), 1e-300)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    freedom = labels.size - n
    meat = summed.T @ summed * np.outer(scale, scale)
    covariance = inverse @ meat @ inverse * labels.size / max(freedom, 1)
    null = vectors[:, ~known]
    touched = (null**2).sum(axis=1) > SHARED
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
    sd = np.where(dead | touched | (freedom < 1), np.inf, sd)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(root, root)
    correlation[dead | touched] = correlation[:, dead | touched] = np.nan
    quantile = stdtrit(max(freedom, 1), 0.975)
    alive = values[int(dead.sum()) :]  # a dead parameter gives one zero eigenvalue
    determined = alive.size > 0 and alive.min() > NULL * alive.max()
    condition = float(np.sqrt(alive.max() / alive.min())) if determined else np.inf
    return Uncertainty(sd, quantile * sd, correlation, condition, dead, null)


def slopes_of(vectors: list[np.ndarray], step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the jacobian (M, 3, n) and the residuals (M, 3) of terms of a loss.

    vectors: of each term (2n+1, M', D), D at most 3, where nothing has moved, and where each of n
    parameters has by a step up and by one down, in turn.
    """
    space = [np.pad(v, [(0, 0), (0, 0), (0, 3 - v.shape[-1])]) for v in vectors]
    every = np.concatenate(space, axis=1)
    return np.moveaxis((every[1::2] - every[2::2]) / (2 * step), 0, -1), every[0]


def cluster_estimates(
    found: Uncertainty,
    names: list[str],
    values: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    converged: bool,
) -> Estimates:
    """Return estimates of positive parameters (n,), whose logarithms `found` is of.

    bounds (n,), (n,): of the values. Parameters that share a direction which the data do not
    determine trade off, whatever their correlation.
    """
    out = {}
    shared = found.null**2 > SHARED
    for i, name in enumerate(names):
        trades = set(partners(found.correlation, i, names))
        for direction in shared.T:
            if direction[i]:
                trades |= {names[j] for j in np.flatnonzero(direction & ~found.dead) if j != i}
        if found.dead[i]:
            trades = set()
        low, high = np.log(bounds[0][i]), np.log(bounds[1][i])
        out[name] = estimate(
            lambda u: float(np.exp(u)), float(np.log(values[i])), float(found.half_width[i]),
            (low, high), log=True, converged=converged, dead=bool(found.dead[i]),
            partners=tuple(sorted(trades)),
        )  # fmt: skip
    condition = found.condition if np.isfinite(found.condition) else None
    return Estimates(out, found.correlation, condition, found.sd)


def block_estimates(found: Fit, clips: list[np.ndarray], time: np.ndarray) -> Estimates:
    """Return estimates of the rope parameters of a least-squares fit of motions.

    By the sandwich of blocks of time: the residual of an open-loop motion wanders for a swing or
    so, and thousands of its samples are worth only as many as there are swings. time (F,) [s] of
    the frames that `clips` are indices of.
    """
    information = found.prior.information
    bread = np.linalg.pinv(found.jacobian.T @ found.jacobian + information, rcond=1e-14)
    block, count = blocks_of(clips, time)
    frame = np.repeat(found.stations.frame, found.stations.residual.shape[1])
    score = np.zeros((count, found.jacobian.shape[1]))
    np.add.at(score, block[frame], found.jacobian * found.z[:, None])
    own = sum(not t.nuisance for t in found.forward.terms)
    freedom = max(count - own, 1)
    covariance = bread @ (count / freedom * score.T @ score + information) @ bread
    sd, correlation = np.sqrt(np.maximum(np.diag(covariance), 1e-300)), correlation_of(covariance)
    quantile = float(stdtrit(freedom, 0.975))
    low, high = found.forward.bounds()
    labels = [t.name for t in found.forward.terms for _ in range(t.size)]
    out = {}
    for k, term in enumerate(t for t in found.forward.terms if not t.nuisance):
        out[term.name] = estimate(
            term.value_of, found.point.u[k], quantile * sd[k], (low[k], high[k]), log=term.log,
            converged=found.converged, partners=partners(correlation, k, labels),
        )  # fmt: skip
    return Estimates(out, correlation[:own, :own], condition_of(correlation[:own, :own]), sd)


def blocks_of(clips: list[np.ndarray], time: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the block (F,) that each frame of some clips lies in, -1 for the others, and how many
    blocks there are."""
    block, count = np.full(len(time), -1), 0
    for clip in clips:
        inside = ((time[clip] - time[clip[0]]) / BLOCK).astype(int)
        block[clip] = count + inside
        count += int(inside.max()) + 1
    return block, count
