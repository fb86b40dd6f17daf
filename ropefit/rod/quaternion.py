"""Unit quaternions (w, x, y, z) as arrays (..., 4), of numpy or as tensors.

The two maps that the rod's strains need are a quadratic and a bilinear form in the entries; their
coefficients are constants, so a strain and its exact gradient are one matrix product each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from ropefit.rod.either import like, namespace

Quaternion = Float[Any, "*#batch 4"]
Vector = Float[Any, "*#batch 3"]


def _director_form() -> np.ndarray:
    """Return (3, 4, 4) symmetric D with (R(q) e3)_a = q^T D_a q / 2 for a unit quaternion."""
    form = np.zeros((3, 4, 4))
    for a, b, c, value in [
        (0, 1, 3, 2.0), (0, 0, 2, 2.0),
        (1, 2, 3, 2.0), (1, 0, 1, -2.0),
        (2, 0, 0, 2.0), (2, 1, 1, -2.0), (2, 2, 2, -2.0), (2, 3, 3, 2.0),
    ]:  # fmt: skip
        form[a, b, c] = form[a, c, b] = value
    return form


def _darboux_form() -> np.ndarray:
    """Return (4, 4, 4) B with (p* q)_a = p^T B_a q, the product of the conjugate of p with q."""
    form = np.zeros((4, 4, 4))
    form[0] = np.eye(4)
    for axis, (i, j) in {1: (2, 3), 2: (3, 1), 3: (1, 2)}.items():
        form[axis, 0, axis], form[axis, axis, 0] = 1.0, -1.0
        form[axis, i, j], form[axis, j, i] = -1.0, 1.0
    return form


DIRECTOR = _director_form()
DARBOUX = _darboux_form()
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def director_gradient(q: Quaternion) -> Float[Any, "*#batch 3 4"]:
    """Return (..., 3, 4) G, the derivative of the third director R(q) e3 = G q / 2 in q."""
    return (q @ like(DIRECTOR.reshape(12, 4).T, q)).reshape(*q.shape[:-1], 3, 4)


def director(q: Quaternion) -> Vector:
    """Return (..., 3) the third director R(q) e3: the tangent that the frame q holds."""
    return 0.5 * (director_gradient(q) @ q[..., None])[..., 0]


def conjugate_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return (..., 4) p* q: the rotation from frame p to frame q, seen from p."""
    xp = namespace(p, q)
    a, v = p[..., :1], p[..., 1:]
    b, w = q[..., :1], q[..., 1:]
    real = a * b + (v * w).sum(-1)[..., None]
    return xp.concat([real, a * w - b * v - cross(v, w)], axis=-1)


def cross(a: Vector, b: Vector) -> Vector:
    """Return (..., 3) a x b."""
    xp = namespace(a, b)
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return xp.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def norms(a: Vector) -> Float[Any, "*batch 1"]:
    """Return (..., 1) the lengths of vectors."""
    x, y, z = a[..., :1], a[..., 1:2], a[..., 2:]
    return namespace(a).sqrt(x * x + y * y + z * z)


def normalise(q: Float[Any, "*batch n"]) -> Float[Any, "*batch n"]:
    """Return (..., n) q / |q|; a zero quaternion (or vector) stays zero."""
    return q / namespace(q).sqrt((q * q).sum(-1)[..., None] + 1e-300)


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return (..., 4) the Hamilton product p q."""
    return conjugate_product(p * like(CONJUGATE, q), q)


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return (..., 3) R(q) v of a unit quaternion."""
    scalar, vector = q[..., :1], q[..., 1:]
    across = 2 * cross(vector, v)
    return v + scalar * across + cross(vector, across)


def from_rotation_vector(v: Vector) -> Quaternion:
    """Return (..., 4) the rotation by |v| radians about v (..., 3), smooth at zero."""
    xp = namespace(v)
    square = (v * v).sum(-1)[..., None]
    half = xp.sqrt(square + 1e-32) / 2
    return xp.concat([xp.cos(half), v * xp.sinc(half / np.pi) / 2], axis=-1)


def transport(
    tangents: Float[Any, "*batch n 3"], first: Float[Any, "*batch 4"] | None = None
) -> Float[Any, "*batch n 4"]:
    """Return (..., N, 4) frames along a polyline by parallel transport: R(q_i) e3 = t_i.

    tangents: (..., N, 3) unit. first: (..., 4) frame of the first tangent; without one, the
    smallest rotation from e3. Each next frame is the last one turned by the smallest rotation
    between tangents.
    """
    xp = namespace(tangents)
    if first is None:
        e3 = xp.zeros_like(tangents[..., 0, :])
        e3[..., 2] = 1.0
        first = smallest_rotation(e3, tangents[..., 0, :])
    assert first is not None
    turns = smallest_rotation(tangents[..., :-1, :], tangents[..., 1:, :])
    frames = xp.concat([first[..., None, :], turns], axis=-2)
    reach = 1  # of a product: how many turns before its own are in it
    while reach < tangents.shape[-2]:
        further = multiply(frames[..., reach:, :], frames[..., :-reach, :])
        frames = xp.concat([frames[..., :reach, :], further], axis=-2)
        reach *= 2
    return frames


def smallest_rotation(a: Vector, b: Vector) -> Quaternion:
    """Return (..., 4) the rotation of least angle with R a = b (unit vectors); any axis for a half
    turn."""
    xp = namespace(a, b)
    real = 1.0 + (a * b).sum(-1)[..., None]
    # Opposite vectors: any axis across a will do, here across the axis that a has least of.
    smallest = xp.argmin(xp.abs(a), axis=-1)
    other = like(np.eye(3), a)[smallest]
    opposite = real < 1e-12
    real = xp.where(opposite, xp.zeros_like(real), real)
    axis = xp.where(opposite, cross(a, other), cross(a, b))
    return normalise(xp.concat([real, axis], axis=-1))
