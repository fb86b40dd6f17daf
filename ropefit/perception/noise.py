"""How points scatter: the part that every point has for itself, and the part neighbours share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from ropefit.perception.trace import Trace

STIFFEST = 16  # cubic spans of the curve that is fitted: a rope bends no oftener along its length
LEAST_POINTS = 60  # in a frame
MOST_POINTS, MOST_FRAMES = 200, 6  # that the shared part is measured from, evenly chosen
LENGTHS = 8  # correlation lengths that are tried, from a hundredth of the rope to a span
EVIDENT = 3.0  # nats: a shared part that raises the likelihood by less is none
CLIP = 4.0  # robust sd: residuals beyond are outliers, not noise


@dataclass(frozen=True)
class Noise:
    """white (F,) [m] sd of the part that each point has for itself, NaN where not measured;
    correlated [m] sd of the part that neighbours share; length [m] over which that falls to 1/e."""

    white: np.ndarray
    correlated: float
    length: float


def measure(traces: list[Trace]) -> Noise | None:
    """Return white and correlated noise of frames of one rope; None where no frame has points
    enough.

    Restricted maximum likelihood: how likely each share and correlation length makes the
    points' distances from a flexible curve, what the curve takes away counted in. The length is
    known to a factor of two or so; the white part well.
    """
    usable = [t for t, trace in enumerate(traces) if len(trace.points) >= LEAST_POINTS]
    if not usable:
        return None
    scale = float(np.median([trace.length for trace in traces]))
    frames = {t: found for t in usable if (found := _frame(traces[t])) is not None}
    if not frames:
        return None
    some = np.array(sorted(frames))
    some = some[np.unique(np.linspace(0, len(some) - 1, MOST_FRAMES).round().astype(int))]
    lengths = scale * np.geomspace(0.01, 1 / STIFFEST, LENGTHS)
    ratios = np.concatenate([[0.0], np.geomspace(0.02, 20.0, 25)])  # shared over white variance
    likelihood = np.zeros((len(lengths), len(ratios)))
    kept = np.zeros(len(lengths))
    square, count = np.zeros(likelihood.shape), 0
    logs = np.zeros(likelihood.shape)
    for t in some:
        place, basis, left = frames[t]
        rest = _complement(basis)
        z = rest.T @ left
        count += z.size
        for i, length in enumerate(lengths):
            shared = np.exp(-np.abs(place[:, None] - place[None]) / length)
            values, vectors = np.linalg.eigh(rest.T @ shared @ rest)
            values = np.maximum(values, 0.0)
            power = ((vectors.T @ z) ** 2).sum(axis=1)
            variance = 1 + ratios[:, None] * values
            square[i] += (power / variance).sum(axis=1)
            logs[i] += left.shape[1] * np.log(variance).sum(axis=1)
            kept[i] += values.mean() / len(some)
    white = square / count  # the likeliest variance at each length and ratio
    likelihood = -0.5 * (count * np.log(white) + logs)
    if likelihood.max() - likelihood[:, 0].max() < EVIDENT:
        likelihood[:, 1:] = -np.inf  # each point for itself explains the data as well
    # Long and strong is nearly as likely as short and weak: their mean, not the very likeliest.
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    shared = float((weight * ratios * white).sum())
    length = float(np.exp((weight * np.log(lengths)[:, None]).sum()))
    taken = float((weight * ratios * white * kept[:, None]).sum())
    own = np.full(len(traces), np.nan)
    for t, (place, basis, left) in frames.items():
        total = float((left**2).sum()) / (left.shape[1] * (len(place) - basis.shape[1]))
        own[t] = np.sqrt(max(total - taken, 0.0))
    return Noise(own, float(np.sqrt(shared)), length)


def _frame(trace: Trace) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return (arc (N,), basis (N, B), residuals (N, 2) [m] square to the rope) of points of one
    frame."""
    pick = np.unique(np.linspace(0, len(trace.points) - 1, MOST_POINTS).astype(int))
    points, place = trace.points[pick], np.maximum.accumulate(trace.point_arc[pick])
    # Knots by share of points, so that a hidden stretch leaves no span without any.
    inner = np.quantile(place, np.linspace(0, 1, STIFFEST + 1)[1:-1])
    if not (np.diff(np.r_[place[0], np.asarray(inner, dtype=float), place[-1]]) > 0).all():
        return None
    knots = np.concatenate([[place[0]] * 4, inner, [place[-1]] * 4])
    basis = BSpline.design_matrix(place, knots, 3).toarray()
    weight = np.ones(len(place))
    for _ in range(3):
        scaled = weight[:, None]
        weights = np.linalg.lstsq(basis * scaled, points * scaled, rcond=None)[0]
        left = points - basis @ weights
        size = np.linalg.norm(left, axis=1)
        weight = np.where(size > CLIP * np.median(size) + 1e-12, 1e-3, 1.0)
    tangent = BSpline(knots, weights, 3)(place, 1)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    least = np.eye(3)[np.argmin(np.abs(tangent).mean(axis=0))]
    first = np.cross(tangent, least)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    second = np.cross(tangent, first)
    across = np.column_stack([(left * first).sum(axis=1), (left * second).sum(axis=1)])
    robust = 1.4826 * np.median(np.abs(across), axis=0) + 1e-12
    return place, basis, np.clip(across, -CLIP * robust, CLIP * robust)


def _complement(basis: np.ndarray) -> np.ndarray:
    """Return (N, N - rank) orthonormal directions that no curve of the basis (N, B) can follow."""
    u, size, _ = np.linalg.svd(basis, full_matrices=True)
    return u[:, int((size > 1e-9 * size[0]).sum()) :]
