"""What is known of a model's search variables beforehand: each by itself, or several together."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Joint:
    """The covariance (n, n) of the search variables of several terms, known from other data."""

    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Prior:
    """A normal distribution of P search variables about zero: one sigma sd (P,), inf for none; and
    the variables (n,) that are known together, each group with its covariance (n, n)."""

    sd: np.ndarray
    together: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    @cached_property
    def held(self) -> np.ndarray:
        """Return (P,) bool: the variables of which something is known."""
        return np.isfinite(self.sd)

    @cached_property
    def factor(self) -> np.ndarray:
        """Return (H, P) the residual rows per search variable: half their squares is how unlikely
        values are."""
        rows = np.diag(1 / self.sd)
        for mine, covariance in self.together:
            scale = 1 / np.sqrt(np.diag(covariance))
            correlation = covariance * np.outer(scale, scale)
            inverse = np.linalg.inv(np.linalg.cholesky(correlation))
            rows[np.ix_(mine, mine)] = inverse * scale
        return rows[self.held]

    @cached_property
    def information(self) -> np.ndarray:
        """Return (P, P) the information."""
        if not self.together:
            return np.diag(np.where(self.held, 1 / self.sd**2, 0.0))
        return self.factor.T @ self.factor

    def rows(self, u: np.ndarray) -> np.ndarray:
        """Return (H,) the residual rows at search variables u (P,)."""
        return self.factor @ u

    def drawn(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Return (P, count) search variables from the prior; zero where nothing is known."""
        standard = rng.normal(size=(len(self.sd), count))
        out = np.where(self.held, self.sd, 0.0)[:, None] * standard
        for mine, covariance in self.together:
            out[mine] = np.linalg.cholesky(covariance) @ standard[mine]
        return out

    def with_broad(self, sd: np.ndarray) -> Prior:
        """Return the prior with broad ones (P,), inf for none, where nothing is known."""
        return Prior(np.fmin(self.sd, sd), self.together)
