"""Log Bayes factors of hypotheses, with nominal and calibration parameters projected out.

This is a score test (Rao 1948). For the sensitivity S to an effect at one place and the whitened
residual z of the nominal fit, A = SᵀGS is the part of S that nominal parameters and calibration
errors cannot reproduce, and Sᵀz is already free of the rest. With sizes drawn from N(0, τ²) (in
usual sizes), averaged over places and a spread of τ, the factor corrects for the number of places
and sizes tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.inference.least_squares import Fit, inside

PRIOR_SIZES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)  # usual sizes: τ
FREE_PRIOR_SD = 100.0  # search variables: of parameters without a prior
SECOND_DISTANCE = 0.2  # of the rope: how far a second start is from the best place
SECOND_FACTOR = 0.6  # of the best place's log factor: least of a second start
WIDTH_FACTOR = 0.1  # of the same: least of a start of another width


class Projection:
    """G = 1 - J (JᵀJ + prior⁻²)⁻¹ Jᵀ of a fit, without the parameters at their bounds.

    z (M D,): the residual at the optimum of the linearised fit. A search stops a little short of
    it, and the difference would look like an effect that the model has already.
    """

    def __init__(self, fit: Fit) -> None:
        self.free = free = inside(fit)
        self.jacobian = fit.jacobian * free
        held, known = fit.prior.held, fit.prior.information
        # Parameters without any sensitivity (an edge beyond the rope) are held by a broad prior.
        broad = np.diag(np.where(held, 0.0, FREE_PRIOR_SD**-2))
        information = self.jacobian.T @ self.jacobian + known + broad
        # In units in which all are as well known: what a rope far off responds to by a million
        # times more would make the priors of the others rounding errors.
        unit = np.sqrt(np.diag(information))
        scaled = information / np.outer(unit, unit)
        self.inverse = np.linalg.pinv(scaled, rcond=1e-13, hermitian=True) / np.outer(unit, unit)
        # One at its bound is not allowed for: in simulated recordings it would look like an effect.
        prior = np.where(free, known @ fit.point.u, 0.0)
        left = self.inverse @ (self.jacobian.T @ fit.z - prior)
        self.z = fit.z - self.jacobian @ left

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return G values, (M D, ...)."""
        flat = values.reshape(len(values), -1)
        flat = flat - self.jacobian @ (self.inverse @ (self.jacobian.T @ flat))
        return flat.reshape(values.shape)


@dataclass(frozen=True)
class Score:
    """A hypothesis scored against a residual: log Bayes factor, best place, and sizes there.

    score: T² of the best place; places (Q,): log factor at each. second: another place, far from
    the best and nearly as good, with the sizes there. widths: of stretches, the same of the best
    place of every width.
    """

    hypothesis: Hypothesis
    log_factor: float
    best: int
    sizes: np.ndarray  # (k,) in SI, at the best place
    score: float
    places: np.ndarray
    second: tuple[np.ndarray, np.ndarray] | None = None
    widths: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    def starts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return the sizes and places from which full fits start."""
        best = (self.sizes, self.hypothesis.places[self.best])
        return [best] if self.second is None else [best, self.second]


class Scorer:
    """Score one hypothesis against any number of residuals."""

    def __init__(self, sensitivity: Sensitivity, project: Projection, scales: np.ndarray) -> None:
        self.hypothesis, self.scales = sensitivity.hypothesis, scales
        s = sensitivity.values
        self.flat = s.reshape(len(s), -1)
        kept = project(s)
        self.a = np.einsum("mqk,mql->qkl", s, kept)
        values, self.vectors = np.linalg.eigh(self.a)  # (Q, k), (Q, k, k)
        self.strength = np.maximum(values, 0.0)

    def log_factors(self, z: np.ndarray) -> np.ndarray:
        """Return (Q, R) log Bayes factors at every place for residuals z (M D, R)."""
        b = (self.flat.T @ z).reshape(*self.a.shape[:2], -1)
        turned = np.einsum("qkl,qkr->qlr", self.vectors, b)
        parts = []
        for tau in PRIOR_SIZES:
            precision = self.strength + 1 / tau**2
            value = 0.5 * (turned**2 / precision[..., None]).sum(1)
            value -= 0.5 * np.log1p(tau**2 * self.strength).sum(1)[:, None]
            if self.hypothesis.positive:
                mean = turned[:, 0] / precision[:, :1] * np.sign(self.vectors[:, 0, 0])[:, None]
                value += np.log(2.0) + log_ndtr(mean * np.sqrt(precision[:, :1]))
            parts.append(value)
        return logsumexp(np.stack(parts), axis=0) - np.log(len(PRIOR_SIZES))

    def averaged(self, z: np.ndarray) -> np.ndarray:
        """Return (R,) log Bayes factors, averaged over places."""
        factors = self.log_factors(z)
        return logsumexp(factors, axis=0) - np.log(len(factors))

    def __call__(self, z: np.ndarray) -> Score:
        """Score one residual (M D,)."""
        places = self.log_factors(z[:, None])[:, 0]
        best = int(np.argmax(places))
        sizes, score = self._sizes(z, best)
        factor = float(logsumexp(places) - np.log(len(places)))
        second, widths = None, ()
        at = self.hypothesis.places
        if at.shape[1]:
            shaping = self.hypothesis.effect.shaping
            along = at[:, shaping if at.shape[1] > shaping else 0]
            apart = np.abs(along - along[best]) > SECOND_DISTANCE * np.ptp(along)
            other = int(np.argmax(np.where(apart, places, -np.inf)))
            if apart[other] and places[other] > SECOND_FACTOR * places[best]:
                second = (self._sizes(z, other)[0], at[other])
        if self.hypothesis.effect.locus == "interval":
            each = (np.flatnonzero(at[:, -1] == width) for width in np.unique(at[:, -1]))
            tops = [int(of[np.argmax(places[of])]) for of in each]
            high = [q for q in tops if places[q] > WIDTH_FACTOR * places[best] > 0]
            widths = tuple((self._sizes(z, q)[0], at[q]) for q in high)
        return Score(self.hypothesis, factor, best, sizes, score, places, second, widths)

    def _sizes(self, z: np.ndarray, place: int) -> tuple[np.ndarray, float]:
        """Return expected sizes (k,) in SI at a place, and T² of the best-fitting ones."""
        b = self.flat.reshape(len(z), *self.a.shape[:2])[:, place].T @ z
        best = np.linalg.pinv(self.a[place], rcond=1e-8, hermitian=True) @ b
        # The best-fitting sizes are far off in directions with little sensitivity; their posterior
        # means are useful starts.
        strength, turned = self.strength[place], self.vectors[place].T @ b
        tau = np.array(PRIOR_SIZES)[:, None]
        precision = strength + 1 / tau**2
        factor = (turned**2 / precision - np.log1p(tau**2 * strength)).sum(axis=1)
        expected = self.vectors[place] @ (turned / precision[np.argmax(factor)])
        return expected * self.scales, float(b @ best)

    def detectable(self, threshold: float) -> float:
        """Return the size (first quantity, SI) whose expected log factor reaches the threshold, as
        the median over places."""
        strength = np.sqrt(np.maximum(self.a[:, 0, 0], 1e-300))
        cost = 2.0 + np.log(max(len(self.a), 1)) + 0.5 * self.a.shape[1]
        return float(np.median(np.sqrt(2 * (threshold + cost)) / strength) * self.scales[0])


def null_residuals(
    fit: Fit, project: Projection, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Return (M D, count) residuals of nominal fits to recordings with nothing left out: noise,
    and calibration errors drawn from their priors."""
    noise = rng.normal(size=(len(fit.z), count))
    errors = project.free[:, None] * fit.prior.drawn(count, rng)
    return project(noise + fit.jacobian @ errors)
