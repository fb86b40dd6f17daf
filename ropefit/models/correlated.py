"""Values that are known together from other data: better than each by itself says."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ropefit.models.terms import Apply, Term, merged

FARTHEST = 30.0  # standard deviations: how far a search may go
JITTER = 1e-9  # of a variance: what rounding may take from a correlation


@dataclass(frozen=True)
class Correlated(Term):
    """A term whose search variables are standard normal and independent of each other a priori:
    values (n,) are start + root @ u, so that root @ root.T is their covariance."""

    root: np.ndarray = field(kw_only=True)

    def value(self, u: np.ndarray) -> np.ndarray:
        return self.start + self.root @ u

    def search(self, value: np.ndarray) -> np.ndarray:
        return np.linalg.solve(self.root, value - self.start)

    def slope(self, u: np.ndarray) -> np.ndarray:
        raise NotImplementedError("every value depends on every search variable")

    def interval(
        self, u: np.ndarray, covariance: np.ndarray, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        half = width * np.sqrt(np.diag(self.root @ covariance @ self.root.T))
        return self.value(u) - half, self.value(u) + half


def correlated(
    name: str, terms: list[Term], covariance: np.ndarray, at_once: Apply | None = None
) -> Correlated:
    """Return the terms as one, about their starts, under a covariance (n, n) in SI; at_once: as of
    `merged`."""
    whole = merged(name, terms, at_once)
    sd = np.sqrt(np.diag(covariance))
    values, axes = np.linalg.eigh(covariance / np.outer(sd, sd))
    root = sd[:, None] * axes * np.sqrt(np.maximum(values, 0.0) + JITTER)
    start, one = whole.start, np.ones(whole.size)
    far = FARTHEST * root @ one
    return Correlated(
        name, whole.names, whole.units, whole.apply, start, one, start - far, start + far, one,
        root=root,
    )  # fmt: skip
