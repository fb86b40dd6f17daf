"""The smooth force that would explain what is left, frame by frame: where it acts, and whether it
is more than noise (DIAGNOSIS, section 3)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ropefit.inference.diagnosis.columns import loads_to_nodes
from ropefit.inference.diagnosis.evidence import Projection
from ropefit.inference.least_squares import Fit, sensitivity

KNOTS = 10
SMOOTH = 0.15  # of the length: over which the force changes
SIZES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0)  # weights of the rope per length of the rope


@dataclass
class Latent:
    """arc (KNOTS,) share of the length; force, sd (F, KNOTS, 3) [N/m]; evidence [nats] that it is
    there; threshold [nats] of a clean recording."""

    arc: np.ndarray
    force: np.ndarray
    sd: np.ndarray
    evidence: float
    threshold: float
    parts: list[tuple[np.ndarray, np.ndarray]]  # rows and modes (m, r) of each frame

    def null(self, residuals: np.ndarray) -> np.ndarray:
        """(R,) evidence of residuals (M D, R)."""
        return np.max([self._evidence(residuals, size) for size in SIZES], axis=0)

    def _evidence(self, z: np.ndarray, size: float) -> np.ndarray:
        """The noise's size is taken from what no force moves, so that noise a little larger than
        thought is no force."""
        explained, cost, inside, rank = 0.0, 0.0, 0.0, 0
        for rows, (left, strength) in zip((r for r, _ in self.parts), self.modes, strict=True):
            square = (left.T @ z[rows]) ** 2
            s2 = (size * strength) ** 2
            explained = explained + 0.5 * ((s2 / (1 + s2))[:, None] * square).sum(0)
            cost += 0.5 * float(np.log1p(s2).sum())
            inside = inside + square.sum(0)
            rank += left.shape[1]
        outside = ((z**2).sum(0) - inside) / max(len(z) - rank, 1)
        return explained / np.maximum(outside, 1e-12) - cost

    @cached_property
    def modes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Left singular vectors and values of each frame's modes that show at all."""
        out = []
        for _, matrix in self.parts:
            left, strength, _ = np.linalg.svd(matrix, full_matrices=False)
            kept = strength > 0.03 / max(SIZES)
            out.append((left[:, kept], strength[kept]))
        return out


def latent_force(found: Fit, project: Projection) -> Latent:
    """The posterior of a force per length, smooth along the rope and free from frame to frame."""
    s, point, setup = found.stations, found.point, found.point.setup
    frames, nodes = point.seen.shape[:2]
    arc = setup.arc.detach().numpy()
    length = arc[-1]
    knots = np.linspace(0, 1, KNOTS)
    hats = np.maximum(0, 1 - np.abs(arc[:, None] / length - knots) * (KNOTS - 1))  # (K, KNOTS)
    per_node = hats * (length / (nodes - 1))
    p = setup.properties
    weight = float((p.density * p.length).sum() * setup.gravity.norm()) / length
    apart = np.abs(knots[:, None] - knots)
    prior = np.linalg.cholesky(np.exp(-apart / SMOOTH) + 1e-9 * np.eye(KNOTS))
    load = np.zeros((frames, KNOTS * 3, nodes, 3))
    for k in range(KNOTS):
        for a in range(3):
            load[:, 3 * k + a, :, a] = per_node[:, k] * weight
    dx = loads_to_nodes(point, load)
    whitened = sensitivity(dx, s, s, found.whitener)
    mixing = np.kron(prior, np.eye(3))
    rows_of = np.repeat(s.frame, s.residual.shape[1])
    parts = []
    for t in range(frames):
        rows = np.flatnonzero(rows_of == t)
        parts.append((rows, whitened[rows] @ mixing))
    latent = Latent(knots, np.zeros((frames, KNOTS, 3)), np.zeros((frames, KNOTS, 3)), 0, 0, parts)
    z = found.z[:, None]
    scores = [float(latent._evidence(z, size)[0]) for size in SIZES]
    best = int(np.argmax(scores))
    latent.evidence, size = scores[best], SIZES[best]
    for t, (rows, modes) in enumerate(parts):
        m = modes * size
        covariance = np.linalg.inv(m.T @ m + np.eye(m.shape[1]))
        mean = mixing @ (covariance @ (m.T @ found.z[rows])) * size * weight
        sd = np.sqrt(np.diag(mixing @ covariance @ mixing.T)) * size * weight
        latent.force[t], latent.sd[t] = mean.reshape(KNOTS, 3), sd.reshape(KNOTS, 3)
    return latent
