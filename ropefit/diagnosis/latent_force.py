"""The latent force: smooth along the rope and slow in time, it would explain what is left.

A Gaussian process prior on force per length; its posterior says where it acts, its evidence
whether it is more than noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.diagnosis.scan import Projection
from ropefit.inference.least_squares import Fit, by_parts
from ropefit.models.slopes import Change
from ropefit.rod.setup import Setup

ARC_KNOTS = 10
ARC_CORRELATION = 0.15  # of the length
TIME_KNOTS = 6  # over the recording: physics follows the motion, noise does not
TIME_CORRELATION = 0.25  # of the recording
PRIOR_SIZES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # weights of the rope per length
WEAKEST_MODE = 0.03  # sd of the data, by the largest force


@dataclass
class LatentForce:
    """arc (ARC_KNOTS,) share of the length; force, sd (F, ARC_KNOTS, 3) [N/m]; evidence [nats] of a
    force; threshold [nats] of a clean recording."""

    arc: np.ndarray
    force: np.ndarray
    sd: np.ndarray
    evidence: float
    threshold: float
    modes: np.ndarray  # (M D, r) orthonormal in what nominal and calibration leave
    strength: np.ndarray  # (r,)

    def null(self, residuals: np.ndarray) -> np.ndarray:
        """Return (R,) the evidence in residuals (M D, R)."""
        return np.max([self.at(residuals, size) for size in PRIOR_SIZES], axis=0)

    def at(self, z: np.ndarray, size: float) -> np.ndarray:
        """Return (R,) log Bayes factors of a force of this size for residuals z (M D, R).

        The noise is scaled by the part of z that no such force moves, so that noise a little larger
        than assumed is no force. It is never scaled down: that part may be known better than the
        rest, as what lies across the plane of a motion.
        """
        square = (self.modes.T @ z) ** 2
        s2 = (size * self.strength) ** 2
        outside = ((z**2).sum(0) - square.sum(0)) / max(len(z) - len(s2), 1)
        share = (s2 / (1 + s2))[:, None]
        return 0.5 * (share * square).sum(0) / np.maximum(outside, 1.0) - 0.5 * np.log1p(s2).sum()


def latent_force(fitted: Fit, project: Projection) -> LatentForce:
    """Return the posterior of a force per length, smooth along the rope and slow in time."""
    s, point, setup = fitted.stations, fitted.point, fitted.point.setup
    frames, nodes = point.seen.shape[:2]
    arc = setup.arc
    length = arc[-1]
    knots = np.linspace(0, 1, ARC_KNOTS)
    hats = np.maximum(
        0, 1 - np.abs(arc[:, None] / length - knots) * (ARC_KNOTS - 1)
    )  # (K, ARC_KNOTS)
    weight = float(setup.weight) / length
    load = np.zeros((ARC_KNOTS * 3, nodes, 3))
    for k in range(ARC_KNOTS):
        for a in range(3):
            load[3 * k + a, :, a] = hats[:, k] * (length / (nodes - 1)) * weight
    if fitted.forward.instantaneous:
        parts = point.by_loads(len(load), lambda index: np.repeat(load[None], len(index), axis=0))
        many = TIME_KNOTS
    else:  # what a force does lasts: a steady one
        parts, many = point.parts([_loaded(setup, one) for one in load]), 1
    whitened = by_parts(fitted, parts, len(load))
    times = np.linspace(0, 1, many)
    over = np.linspace(0, 1, frames)
    when = np.maximum(0, 1 - np.abs(over[:, None] - times) * (many - 1))  # (F, many)
    of = when[np.repeat(s.frame, s.residual.shape[1])]
    columns = (of[:, :, None] * whitened[:, None, :]).reshape(len(of), -1)
    mixing = np.kron(
        _root(times, TIME_CORRELATION), np.kron(_root(knots, ARC_CORRELATION), np.eye(3))
    )
    columns = columns @ mixing
    modes, strength, right = np.linalg.svd(project(columns), full_matrices=False)
    kept = strength > WEAKEST_MODE / max(PRIOR_SIZES)
    modes, strength, right = modes[:, kept], strength[kept], right[kept]
    latent = LatentForce(knots, np.empty(0), np.empty(0), 0.0, 0.0, modes, strength)
    scores = [float(latent.at(project.z[:, None], size)[0]) for size in PRIOR_SIZES]
    best = int(np.argmax(scores))
    latent.evidence, size = scores[best], PRIOR_SIZES[best]
    shrink = size * strength / (1 + (size * strength) ** 2)
    mean = right.T @ (shrink * (modes.T @ project.z)) * size * weight
    covariance = np.eye(right.shape[1]) - (right.T * (size * strength * shrink)) @ right
    root = mixing @ np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance)))
    sd = np.sqrt((root**2).sum(1)) * size * weight
    latent.force = np.einsum("fj,jka->fka", when, (mixing @ mean).reshape(many, ARC_KNOTS, 3))
    latent.sd = np.einsum("fj,jka->fka", when, sd.reshape(many, ARC_KNOTS, 3))
    return latent


def _loaded(setup: Setup, load: np.ndarray) -> Change:
    return lambda step: setup._replace(load=setup.load + step * load)


def _root(at: np.ndarray, scale: float) -> np.ndarray:
    """Return the Cholesky factor of an exponential correlation over places (n,)."""
    apart = np.abs(at[:, None] - at)
    return np.linalg.cholesky(np.exp(-apart / scale) + 1e-9 * np.eye(len(at)))
