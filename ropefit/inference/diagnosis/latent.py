"""The smooth force that would explain what is left, slow from frame to frame: where it acts, and
whether it is more than noise (DIAGNOSIS, section 3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.inference.diagnosis.columns import loads_to_nodes
from ropefit.inference.diagnosis.evidence import Projection
from ropefit.inference.least_squares import Fit, sensitivity

KNOTS = 10
SMOOTH = 0.15  # of the length: over which the force changes
TIMES = 6  # knots over the recording: physics follows the motion, noise does not
SLOW = 0.25  # of the recording: over which the force changes
SIZES = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # weights of the rope per length


@dataclass
class Latent:
    """arc (KNOTS,) share of the length; force, sd (F, KNOTS, 3) [N/m]; evidence [nats] that it is
    there; threshold [nats] of a clean recording."""

    arc: np.ndarray
    force: np.ndarray
    sd: np.ndarray
    evidence: float
    threshold: float
    modes: np.ndarray  # (M D, r) orthonormal in what nominal and calibration leave
    strength: np.ndarray  # (r,)

    def null(self, residuals: np.ndarray) -> np.ndarray:
        """(R,) evidence of residuals (M D, R)."""
        return np.max([self.at(residuals, size) for size in SIZES], axis=0)

    def at(self, z: np.ndarray, size: float) -> np.ndarray:
        """(R,) log Bayes factor of a force of this size for residuals z (M D, R).

        The noise's own size is taken from what no such force moves, so that noise a little larger
        than thought is no force. Smaller it is not: what no force moves may be known better than
        the rest, as what lies across the plane of a motion.
        """
        square = (self.modes.T @ z) ** 2
        s2 = (size * self.strength) ** 2
        outside = ((z**2).sum(0) - square.sum(0)) / max(len(z) - len(s2), 1)
        share = (s2 / (1 + s2))[:, None]
        return 0.5 * (share * square).sum(0) / np.maximum(outside, 1.0) - 0.5 * np.log1p(s2).sum()


def latent_force(found: Fit, project: Projection) -> Latent:
    """The posterior of a force per length, smooth along the rope and slow over the recording."""
    s, point, setup = found.stations, found.point, found.point.setup
    frames, nodes = point.seen.shape[:2]
    arc = setup.arc.detach().numpy()
    length = arc[-1]
    knots = np.linspace(0, 1, KNOTS)
    hats = np.maximum(0, 1 - np.abs(arc[:, None] / length - knots) * (KNOTS - 1))  # (K, KNOTS)
    weight = float(setup.weight) / length
    load = np.zeros((frames, KNOTS * 3, nodes, 3))
    for k in range(KNOTS):
        for a in range(3):
            load[:, 3 * k + a, :, a] = hats[:, k] * (length / (nodes - 1)) * weight
    whitened = sensitivity(loads_to_nodes(point, load), s, s, found.whitener)
    times = np.linspace(0, 1, TIMES)
    over = np.linspace(0, 1, frames)
    when = np.maximum(0, 1 - np.abs(over[:, None] - times) * (TIMES - 1))  # (F, TIMES)
    of = when[np.repeat(s.frame, s.residual.shape[1])]
    columns = (of[:, :, None] * whitened[:, None, :]).reshape(len(of), -1)
    mixing = np.kron(_root(times, SLOW), np.kron(_root(knots, SMOOTH), np.eye(3)))
    columns = columns @ mixing
    modes, strength, right = np.linalg.svd(project(columns), full_matrices=False)
    kept = strength > 0.03 / max(SIZES)
    modes, strength, right = modes[:, kept], strength[kept], right[kept]
    latent = Latent(knots, np.empty(0), np.empty(0), 0.0, 0.0, modes, strength)
    scores = [float(latent.at(project.z[:, None], size)[0]) for size in SIZES]
    best = int(np.argmax(scores))
    latent.evidence, size = scores[best], SIZES[best]
    shrink = size * strength / (1 + (size * strength) ** 2)
    mean = right.T @ (shrink * (modes.T @ project.z)) * size * weight
    covariance = np.eye(right.shape[1]) - (right.T * (size * strength * shrink)) @ right
    root = mixing @ np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance)))
    sd = np.sqrt((root**2).sum(1)) * size * weight
    latent.force = np.einsum("fj,jka->fka", when, (mixing @ mean).reshape(TIMES, KNOTS, 3))
    latent.sd = np.einsum("fj,jka->fka", when, sd.reshape(TIMES, KNOTS, 3))
    return latent


def _root(at: np.ndarray, scale: float) -> np.ndarray:
    """Cholesky factor of an exponential correlation over places (n,)."""
    apart = np.abs(at[:, None] - at)
    return np.linalg.cholesky(np.exp(-apart / scale) + 1e-9 * np.eye(len(at)))
