"""The tangent basis of search variables, where three of them are the components of a direction.

The length of a direction changes nothing, so that the data have no information of it but rounding
errors. Covariances are therefore computed in the tangent basis: rotations instead of components.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from ropefit.models.model import Model
from ropefit.models.prior import Prior

DIRECTION_SD = 1.0  # rad: prior standard deviation of a direction


class TangentBasis(NamedTuple):
    """Q tangent vectors of P search variables: vectors (P, Q); variable (Q,): which search variable
    each one is, -1 for a rotation [rad] of a direction."""

    vectors: np.ndarray
    variable: np.ndarray

    def information(self, prior: Prior) -> np.ndarray:
        """Return (Q, Q) the information of a prior along the tangent vectors; none of a direction
        whose components have none."""
        components = np.setdiff1d(np.arange(len(self.vectors)), self.variable)
        turns = self.variable < 0
        rotation = DIRECTION_SD**-2 if prior.held[components].all() else 0.0
        own = prior.information[np.ix_(self.variable, self.variable)]
        own = np.where(np.logical_or.outer(turns, turns), 0.0, own)
        return own + np.diag(np.where(turns, rotation, 0.0))

    def covariance(self, tangent: np.ndarray) -> np.ndarray:
        """Return the covariance (P, P) of the search variables from that in this basis (Q, Q)."""
        return self.vectors @ tangent @ self.vectors.T


def tangent_basis(forward: Model, u: np.ndarray) -> TangentBasis | None:
    """Return the tangent basis at search variables u (P,); None where no direction is among
    them."""
    if not any(term.in_direction.any() for term in forward.terms):
        return None
    axes, vectors, variable, first = np.eye(len(u)), [], [], 0
    for term, part in zip(forward.terms, forward.split(u), strict=True):
        mine, components = first + np.arange(term.size), term.in_direction
        first += term.size
        vectors.append(axes[:, mine[~components]])
        variable += mine[~components].tolist()
        if components.any():
            along = (term.value(part) / term.scale)[components]
            across = np.zeros((len(u), len(along) - 1))
            across[mine[components]] = np.linalg.norm(along) * null_space(along[None])
            vectors.append(across)
            variable += [-1] * (len(along) - 1)
    return TangentBasis(np.concatenate(vectors, axis=1), np.array(variable))
