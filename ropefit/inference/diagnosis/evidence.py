"""Log Bayes factors of effects from a scan, with nominal and calibration parameters projected out.

For columns S of an effect at one place and the whitened residual z of the nominal fit, what the
nominal parameters and the calibration errors cannot absorb is A = SᵀGS, and Sᵀz is already free of
it. With sizes drawn from N(0, τ²) (in usual sizes), averaged over places and a spread of τ, the
factor pays for every look by itself (DIAGNOSIS, section 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp

from ropefit.inference.diagnosis.columns import Columns
from ropefit.inference.diagnosis.families import Family
from ropefit.inference.least_squares import Fit

SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
ANYTHING = 100.0  # search variables: how far a free parameter may be off
EDGE = 1e-9  # search variables: what is nearer to its bound is at it
FAR, NEARLY = 0.2, 0.6  # of the rope; of the best place's log factor: a second place to start from


class Projection:
    """G = 1 - J (JᵀJ + prior⁻²)⁻¹ Jᵀ of a fit, without the parameters at their bounds.

    z (M D,): the residual where the linearised fit is at its very best: a search stops a little
    short of that, which would pass for an effect that the model has already.
    """

    def __init__(self, fit: Fit) -> None:
        low, high = fit.forward.bounds()
        inside = (fit.point.u > low + EDGE) & (fit.point.u < high - EDGE)
        self.jacobian = fit.jacobian * inside
        held = np.isfinite(fit.prior)
        # What nothing shows any more (where a stretch ends that covers all of the rope) is held.
        weight = np.where(held, 1 / fit.prior**2, ANYTHING**-2)
        information = self.jacobian.T @ self.jacobian + np.diag(weight)
        self.inverse = np.linalg.pinv(information, rcond=1e-13, hermitian=True)
        self.prior_sd = np.where(held, fit.prior, 0.0)
        prior = np.where(held & inside, fit.point.u / fit.prior**2, 0.0)
        left = self.inverse @ (self.jacobian.T @ fit.z - prior)
        self.z = fit.z - self.jacobian @ left

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """G values, (M D, ...)."""
        flat = values.reshape(len(values), -1)
        flat = flat - self.jacobian @ (self.inverse @ (self.jacobian.T @ flat))
        return flat.reshape(values.shape)


@dataclass(frozen=True)
class Scored:
    """A family against a residual: log Bayes factor, and its best place and sizes there.

    score: T² of the best place; places (Q,): log factor at each. second: another place, far from
    the best and nearly as good, with its sizes.
    """

    family: Family
    log_factor: float
    best: int
    sizes: np.ndarray  # (k,) in SI, at the best place
    score: float
    places: np.ndarray
    second: tuple[np.ndarray, np.ndarray] | None = None

    def starts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Sizes and place from which full fits set out."""
        best = (self.sizes, self.family.places[self.best])
        return [best] if self.second is None else [best, self.second]


class Scorer:
    """Scores one family against any number of residuals."""

    def __init__(self, columns: Columns, project: Projection, scales: np.ndarray) -> None:
        self.family, self.scales = columns.family, scales
        s = columns.values
        self.flat = s.reshape(len(s), -1)
        kept = project(s)
        self.a = np.einsum("mqk,mql->qkl", s, kept)
        values, self.vectors = np.linalg.eigh(self.a)  # (Q, k), (Q, k, k)
        self.strength = np.maximum(values, 0.0)

    def log_factors(self, z: np.ndarray) -> np.ndarray:
        """(Q, R) log Bayes factors at every place for residuals z (M D, R)."""
        b = (self.flat.T @ z).reshape(*self.a.shape[:2], -1)
        turned = np.einsum("qkl,qkr->qlr", self.vectors, b)
        parts = []
        for tau in SIZES:
            precision = self.strength + 1 / tau**2
            value = 0.5 * (turned**2 / precision[..., None]).sum(1)
            value -= 0.5 * np.log1p(tau**2 * self.strength).sum(1)[:, None]
            if self.family.positive:
                mean = turned[:, 0] / precision[:, :1] * np.sign(self.vectors[:, 0, 0])[:, None]
                value += np.log(2.0) + log_ndtr(mean * np.sqrt(precision[:, :1]))
            parts.append(value)
        return logsumexp(np.stack(parts), axis=0) - np.log(len(SIZES))

    def family_factor(self, z: np.ndarray) -> np.ndarray:
        """(R,) averaged over places."""
        found = self.log_factors(z)
        return logsumexp(found, axis=0) - np.log(len(found))

    def __call__(self, z: np.ndarray) -> Scored:
        """Against one residual (M D,)."""
        places = self.log_factors(z[:, None])[:, 0]
        best = int(np.argmax(places))
        sizes, score = self._sizes(z, best)
        factor = float(logsumexp(places) - np.log(len(places)))
        second = None
        at = self.family.places
        if at.shape[1]:
            apart = np.abs(at[:, 0] - at[best, 0]) > FAR * (at[:, 0].max() - at[:, 0].min())
            other = int(np.argmax(np.where(apart, places, -np.inf)))
            if apart[other] and places[other] > NEARLY * places[best]:
                second = (self._sizes(z, other)[0], at[other])
        return Scored(self.family, factor, best, sizes, score, places, second)

    def _sizes(self, z: np.ndarray, place: int) -> tuple[np.ndarray, float]:
        """Sizes (k,) in SI to be expected at a place, and T² of the best there."""
        b = self.flat.reshape(len(z), *self.a.shape[:2])[:, place].T @ z
        best = np.linalg.pinv(self.a[place], rcond=1e-8, hermitian=True) @ b
        # The best go far in a direction that hardly shows: it is the expected that lead somewhere.
        strength, turned = self.strength[place], self.vectors[place].T @ b
        tau = np.array(SIZES)[:, None]
        precision = strength + 1 / tau**2
        factor = (turned**2 / precision - np.log1p(tau**2 * strength)).sum(axis=1)
        expected = self.vectors[place] @ (turned / precision[np.argmax(factor)])
        return expected * self.scales, float(b @ best)

    def detectable(self, threshold: float) -> float:
        """Size (of the first quantity, SI) whose expected log factor reaches the threshold,
        typical over places."""
        strength = np.sqrt(np.maximum(self.a[:, 0, 0], 1e-300))
        cost = 2.0 + np.log(max(len(self.a), 1)) + 0.5 * self.a.shape[1]
        return float(np.median(np.sqrt(2 * (threshold + cost)) / strength) * self.scales[0])


def null_residuals(
    fit: Fit, project: Projection, count: int, rng: np.random.Generator
) -> np.ndarray:
    """(M D, count) residuals of nominal fits to recordings with nothing left out: noise, and
    calibration errors drawn from their priors."""
    noise = rng.normal(size=(len(fit.z), count))
    errors = project.prior_sd[:, None] * rng.normal(size=(len(project.prior_sd), count))
    return project(noise + fit.jacobian @ errors)
