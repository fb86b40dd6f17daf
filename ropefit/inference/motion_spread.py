"""How sure the parameters of a fit on motion are, where what is left is no white noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from ropefit.inference.least_squares import Fit
from ropefit.inference.sandwich import STRONG

BLOCK = 0.5  # s: residuals further apart count as independent
WIDE = 1.1  # half width of a logarithm's interval from which the data hardly say anything
EDGE = 0.005  # of the range


@dataclass(frozen=True)
class Spread:
    """Of the rope's parameters by name, in SI; sd (P,) and correlation (P, P) of all search
    variables; condition number of the rope's own."""

    value: dict[str, float]
    low: dict[str, float]
    high: dict[str, float]
    verdict: dict[str, str]
    partners: dict[str, list[str]]
    sd: np.ndarray
    correlation: np.ndarray
    condition: float | None


def spread_of(found: Fit, clips: list[np.ndarray], time: np.ndarray) -> Spread:
    """Intervals by the sandwich of blocks of time: the residual of an open-loop motion wanders for
    a swing or so, and thousands of its samples are worth only as many as there are swings."""
    bread = np.linalg.pinv(
        found.jacobian.T @ found.jacobian + np.diag(_information(found.prior)), rcond=1e-14
    )
    frame = np.repeat(found.stations.frame, found.stations.residual.shape[1])
    block = np.full(len(time), -1)
    count = 0
    for clip in clips:
        inside = ((time[clip] - time[clip[0]]) / BLOCK).astype(int)
        block[clip] = count + inside
        count += int(inside.max()) + 1
    score = np.zeros((count, found.jacobian.shape[1]))
    np.add.at(score, block[frame], found.jacobian * found.z[:, None])
    own = sum(not t.nuisance for t in found.forward.terms)
    inflate = count / max(count - own, 1)
    meat = inflate * score.T @ score + np.diag(_information(found.prior))
    covariance = bread @ meat @ bread
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = covariance / np.outer(sd, sd)
    quantile = float(stats.t.ppf(0.975, max(count - own, 1)))
    low, high = found.forward.bounds()
    labels = [t.name for t in found.forward.terms for _ in range(t.size)]
    told: dict[str, list] = {}
    for k, term in enumerate(t for t in found.forward.terms if not t.nuisance):
        u = found.point.u[k]
        partners = sorted(
            {labels[j] for j in range(len(sd)) if j != k and abs(correlation[k, j]) > STRONG}
        )
        verdict, width = "determined", quantile * sd[k]
        if not found.converged:
            verdict = "not converged"
        elif min(u - low[k], high[k] - u) < EDGE * (high[k] - low[k]):
            verdict = "at bound"
        elif (width if term.log else 2 * width / (high[k] - low[k])) > WIDE:
            verdict = "trade-off" if partners else "flat direction"
        around = (u, u - min(width, 50.0), u + min(width, 50.0))
        value, least, most = (float(term.value(np.array([v]))[0]) for v in around)
        told[term.name] = [value, least, most, verdict, partners]
    many = len(told)
    values = np.linalg.eigvalsh(correlation[:many, :many])
    return Spread(
        *({name: row[i] for name, row in told.items()} for i in range(5)),
        sd=sd,
        correlation=correlation,
        condition=float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else None,
    )


def _information(prior: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(prior), 1 / np.where(np.isfinite(prior), prior, 1.0) ** 2, 0.0)
