"""The rod's three constraints and their exact gradients (paper, section II-A).

Shapes: x (..., K, 3) [m], q (..., K-1, 4). All values are dimensionless but the distance [m].
"""

from __future__ import annotations

from typing import Any, NamedTuple

from jaxtyping import Float

from ropefit.rod.either import Array, like, namespace
from ropefit.rod.quaternion import DARBOUX, director_gradient

# Of the vector part of p* q: its derivatives in p and q are linear in the other.
BY_FIRST = DARBOUX[1:].reshape(12, 4).T
BY_SECOND = DARBOUX[1:].swapaxes(1, 2).reshape(12, 4).T
TINY = 1e-24  # m²: keeps the direction of two coincident particles at zero instead of NaN


class Rest(NamedTuple):
    """Rest shape: segment lengths (K-1,) [m] and rest Darboux quaternions (K-2, 4)."""

    length: Array
    darboux: Array


def straight_rest(length: float, nodes: int) -> Rest:
    """Return the rest shape of a straight rope of `length` [m], its particles evenly spaced."""
    import torch  # Algorithm 1 is in torch, where it is not compiled

    darboux = torch.zeros(nodes - 2, 4, dtype=torch.float64)
    darboux[:, 0] = 1.0
    return Rest(torch.full((nodes - 1,), length / (nodes - 1), dtype=torch.float64), darboux)


class StretchShear(NamedTuple):
    """C^S (..., K-1, 3), eq. (5); d/dx is -1/l and +1/l times the identity; d/dq (..., K-1, 3,
    4)."""

    value: Array
    grad_q: Array


def stretch_shear(
    edges: Float[Any, "*batch segments 3"], q: Float[Any, "*batch segments 4"], rest: Rest
) -> StretchShear:
    """Return edge over rest length minus third director. edges: x[1:] - x[:-1], (..., K-1, 3)."""
    gradient = director_gradient(q)
    director = 0.5 * (gradient @ q[..., None])[..., 0]
    return StretchShear(edges / rest.length[:, None] - director, -gradient)


class BendTwist(NamedTuple):
    """C^B (..., K-2, 3), eq. (7), with d/dq_i and d/dq_{i+1} (..., K-2, 3, 4)."""

    value: Array
    grad_first: Array
    grad_second: Array


def bend_twist(q: Float[Any, "*batch segments 4"], rest: Rest) -> BendTwist:
    """Return Im(q_i* q_{i+1} - s rest), with the sign s that brings Darboux quaternions closest.

    q and -q are the same frame, so the relative rotation is known up to sign only; s = -1 where it
    lies nearer to minus the rest rotation (Kugelstadt & Schömer 2016).
    """
    first, second = q[..., :-1, :], q[..., 1:, :]
    grad_first = (second @ like(BY_FIRST, q)).reshape(*second.shape[:-1], 3, 4)
    grad_second = (first @ like(BY_SECOND, q)).reshape(*first.shape[:-1], 3, 4)
    imaginary = (grad_second @ second[..., None])[..., 0]
    real = (first * second).sum(-1, keepdim=True)
    along = (imaginary * rest.darboux[:, 1:]).sum(-1, keepdim=True) + real * rest.darboux[:, :1]
    one = namespace(along).ones_like(along)
    sign = namespace(along).where(along < 0, -one, one)
    return BendTwist(imaginary - sign * rest.darboux[:, 1:], grad_first, grad_second)


class Distance(NamedTuple):
    """C^D (..., K-1) [m], eq. (9), and the unit vectors (..., K-1, 3) that are its gradients."""

    value: Array
    direction: Array


def distance(edges: Float[Any, "*batch segments 3"], rest: Rest) -> Distance:
    """Return segment length minus rest length.

    The gradient is the unit vector along the edge. (The paper divides by the rest length instead,
    which is the same once the constraint holds.)
    """
    norm = namespace(edges).sqrt((edges * edges).sum(-1) + TINY)
    return Distance(norm - rest.length, edges / norm[..., None])
