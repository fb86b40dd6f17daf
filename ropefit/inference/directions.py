"""Directions among the search variables: three components whose common length changes nothing.

What has no effect has no information, and rounding would give it some: variances are those of the
turns of a direction, whatever length it has got in a fit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from ropefit.models.model import Model

TURNED = 1.0  # rad: one sigma of a direction of which nothing is known


class Ways(NamedTuple):
    """P' ways in which P search variables may change: ways (P, P'); of (P',) the variable that each
    one is, -1 for a turn [rad] of a direction."""

    ways: np.ndarray
    of: np.ndarray

    def prior(self, prior: np.ndarray) -> np.ndarray:
        """Return (P',) one sigma of the ways, from that of the variables (P,), inf for none; a
        direction has none where its components have none."""
        turned = TURNED if np.isfinite(prior[self.components]).all() else np.inf
        return np.where(self.of < 0, turned, prior[self.of])

    @property
    def components(self) -> np.ndarray:
        """Return the variables that are components of a direction."""
        return np.setdiff1d(np.arange(len(self.ways)), self.of)

    def of_variables(self, covariance: np.ndarray) -> np.ndarray:
        """Return the covariance (P, P) of the variables from that of the ways (P', P')."""
        return self.ways @ covariance @ self.ways.T


def ways_of(forward: Model, u: np.ndarray) -> Ways | None:
    """Return the ways in which search variables u (P,) may change; None where no direction is among
    them."""
    if not any(term.pointing.any() for term in forward.terms):
        return None
    rows, columns, of = np.eye(len(u)), [], []
    first = 0
    for term, part in zip(forward.terms, forward.split(u), strict=True):
        mine = first + np.arange(term.size)
        pointing = term.pointing
        first += term.size
        columns.append(rows[:, mine[~pointing]])
        of += mine[~pointing].tolist()
        if pointing.any():
            along = (term.value(part) / term.scale)[pointing]
            across = np.zeros((len(u), len(along) - 1))
            across[mine[pointing]] = np.linalg.norm(along) * null_space(along[None])
            columns.append(across)
            of += [-1] * (len(along) - 1)
    return Ways(np.concatenate(columns, axis=1), np.array(of))
