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
    name: str, terms: list[Term], covariance: np.ndarray, at_once: Apply | None = None,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
) -> Correlated:  # fmt: skip
    """Return the terms as one, about their starts, under a covariance (n, n) in SI; at_once: as of
    `merged`.

    bounds (n,), (n,) in SI: values beyond them mean nothing, and along with them the others would
    go where the data do not send them. The value that is nearest to its bound is kept within.
    """
    whole = merged(name, terms, at_once)
    sd = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sd, sd)
    start, one = whole.start, np.ones(whole.size)
    low, high = -FARTHEST * one, FARTHEST * one
    if bounds is None:
        values, axes = np.linalg.eigh(correlation)
        root = sd[:, None] * axes * np.sqrt(np.maximum(values, 0.0) + JITTER)
    else:
        away = (bounds[0] - start) / sd, (bounds[1] - start) / sd
        nearest = int(np.argmin(np.minimum(-away[0], away[1])))
        root = sd[:, None] * _beginning_with(nearest, correlation)
        low[nearest] = np.clip(away[0][nearest], -FARTHEST, 0.0)
        high[nearest] = np.clip(away[1][nearest], 0.0, FARTHEST)
    return Correlated(
        name, whole.names, whole.units, whole.apply, start, one, start + root @ low,
        start + root @ high, one, root=root,
    )  # fmt: skip


def _beginning_with(first: int, correlation: np.ndarray) -> np.ndarray:
    """Return a root (n, n) of a correlation in which one value depends on its own search variable
    only (Cholesky, in that order)."""
    order = np.argsort(np.arange(len(correlation)) != first, kind="stable")
    values, axes = np.linalg.eigh(correlation[np.ix_(order, order)])
    positive = (axes * (np.maximum(values, 0.0) + JITTER)) @ axes.T
    root = np.empty_like(correlation)
    root[np.ix_(order, order)] = np.linalg.cholesky(positive)
    return root
