"""How sure a fit is: sandwich covariance by clusters, Student-t intervals, and a verdict for each
number.

The losses are sums of norms. With J the derivative of the residual vectors r_i, the curvature A of
the loss is that of the smoothed norm sqrt(r² + floor²): Σ J_iᵀ (1 - r_i r_iᵀ/ρ²) J_i / ρ with
ρ² = r_i² + floor² (in one dimension this is a kernel estimate of the density at the kink, as in
median regression). The score by cluster (a frame, a segment) is s_c = Σ J_iᵀ r_i/|r_i|. Points of
one cluster are not independent, so the covariance is A⁻¹ (Σ s_c s_cᵀ) A⁻¹ · C/(C-n) with C clusters
(Huber 1967; Liang & Zeger 1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

Verdict = Literal["determined", "trade-off", "flat direction", "dead", "at bound"]
NULL = 1e-9  # eigenvalue of the scaled curvature under which a direction counts as undetermined
INTERVAL = 1.959964  # sd: half of a 95 % interval
STRONG = 0.98  # correlation from which two parameters trade off


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
    """Uncertainty of the minimiser of Σ|r_i|.

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
    touched = (null**2).sum(axis=1) > 1e-3
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * scale
    sd = np.where(dead | touched | (freedom < 1), np.inf, sd)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(root, root)
    correlation[dead | touched] = correlation[:, dead | touched] = np.nan
    quantile = stats.t.ppf(0.975, max(freedom, 1))
    alive = values[int(dead.sum()) :]  # a dead parameter gives one zero eigenvalue
    determined = alive.size > 0 and alive.min() > NULL * alive.max()
    condition = float(np.sqrt(alive.max() / alive.min())) if determined else np.inf
    return Uncertainty(sd, quantile * sd, correlation, condition, dead, null)


def verdicts(
    result: Uncertainty, at_bound: np.ndarray, flat_above: float
) -> list[tuple[Verdict, list[int]]]:
    """(verdict, indices it trades with) for each parameter.

    at_bound (n,) bool; a parameter whose interval is wider than `flat_above` is a flat direction.
    """
    out: list[tuple[Verdict, list[int]]] = []
    n = result.sd.size
    for i in range(n):
        partners: list[int] = []
        if not result.dead[i]:
            for direction in result.null.T:
                if direction[i] ** 2 > 1e-3:
                    partners += [
                        j
                        for j in range(n)
                        if j != i and direction[j] ** 2 > 1e-3 and not result.dead[j]
                    ]
            partners += [
                j
                for j in range(n)
                if j != i and abs(np.nan_to_num(result.correlation[i, j])) > STRONG
            ]
        partners = sorted(set(partners))
        if result.dead[i]:
            out.append(("dead", []))
        elif at_bound[i]:
            out.append(("at bound", partners))
        elif partners:
            out.append(("trade-off", partners))
        elif not result.half_width[i] <= flat_above:
            out.append(("flat direction", []))
        else:
            out.append(("determined", []))
    return out
