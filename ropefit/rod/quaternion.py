"""Unit quaternions (w, x, y, z) as torch tensors (..., 4).

The two maps that the rod's strains need are a quadratic and a bilinear form in the entries; their
coefficients are constants, so a strain and its exact gradient are one matrix product each.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

Quaternion = Float[Tensor, "*#batch 4"]
Vector = Float[Tensor, "*#batch 3"]


def _director_form() -> Tensor:
    """Return (3, 4, 4) symmetric D with (R(q) e3)_a = q^T D_a q / 2 for a unit quaternion."""
    form = torch.zeros(3, 4, 4, dtype=torch.float64)
    for a, b, c, value in [
        (0, 1, 3, 2.0), (0, 0, 2, 2.0),
        (1, 2, 3, 2.0), (1, 0, 1, -2.0),
        (2, 0, 0, 2.0), (2, 1, 1, -2.0), (2, 2, 2, -2.0), (2, 3, 3, 2.0),
    ]:  # fmt: skip
        form[a, b, c] = form[a, c, b] = value
    return form


def _darboux_form() -> Tensor:
    """Return (4, 4, 4) B with (p* q)_a = p^T B_a q, the product of the conjugate of p with q."""
    form = torch.zeros(4, 4, 4, dtype=torch.float64)
    form[0] = torch.eye(4)
    for axis, (i, j) in {1: (2, 3), 2: (3, 1), 3: (1, 2)}.items():
        form[axis, 0, axis], form[axis, axis, 0] = 1.0, -1.0
        form[axis, i, j], form[axis, j, i] = -1.0, 1.0
    return form


DIRECTOR = _director_form()
DARBOUX = _darboux_form()


def director_gradient(q: Quaternion) -> Float[Tensor, "*#batch 3 4"]:
    """Return (..., 3, 4) G, the derivative of the third director R(q) e3 = G q / 2 in q."""
    return (q @ DIRECTOR.reshape(12, 4).T.to(q)).reshape(*q.shape[:-1], 3, 4)


def director(q: Quaternion) -> Vector:
    """Return (..., 3) the third director R(q) e3: the tangent that the frame q holds."""
    return 0.5 * (director_gradient(q) @ q[..., None])[..., 0]


def conjugate_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return (..., 4) p* q: the rotation from frame p to frame q, seen from p."""
    return torch.einsum("abc,...b,...c->...a", DARBOUX.to(q), p, q)


def normalise(q: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch n"]:
    """Return (..., n) q / |q|; a zero quaternion (or vector) stays zero."""
    return q / torch.sqrt((q * q).sum(-1, keepdim=True) + 1e-300)


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return (..., 4) the Hamilton product p q."""
    sign = torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=q.dtype, device=q.device)
    return conjugate_product(p * sign, q)


def rotate(q: Quaternion, v: Vector) -> Vector:
    """Return (..., 3) R(q) v of a unit quaternion."""
    scalar, vector = q[..., :1], q[..., 1:]
    across = 2 * torch.linalg.cross(*torch.broadcast_tensors(vector, v))
    return v + scalar * across + torch.linalg.cross(*torch.broadcast_tensors(vector, across))


def from_rotation_vector(v: Vector) -> Quaternion:
    """Return (..., 4) the rotation by |v| radians about v (..., 3), smooth at zero."""
    square = (v * v).sum(-1, keepdim=True)
    half = torch.sqrt(square + 1e-32) / 2
    return torch.cat([torch.cos(half), v * torch.sinc(half / torch.pi) / 2], dim=-1)


def transport(
    tangents: Float[Tensor, "*batch n 3"], first: Float[Tensor, "*batch 4"] | None = None
) -> Float[Tensor, "*batch n 4"]:
    """Return (..., N, 4) frames along a polyline by parallel transport: R(q_i) e3 = t_i.

    tangents: (..., N, 3) unit. first: (..., 4) frame of the first tangent; without one, the
    smallest rotation from e3. Each next frame is the last one turned by the smallest rotation
    between tangents.
    """
    if first is None:
        e3 = torch.zeros_like(tangents[..., 0, :])
        e3[..., 2] = 1.0
        first = smallest_rotation(e3, tangents[..., 0, :])
    frames = [first]
    for i in range(1, tangents.shape[-2]):
        turn = smallest_rotation(tangents[..., i - 1, :], tangents[..., i, :])
        frames.append(multiply(turn, frames[-1]))
    return torch.stack(frames, dim=-2)


def smallest_rotation(a: Vector, b: Vector) -> Quaternion:
    """Return (..., 4) the rotation of least angle with R a = b (unit vectors); any axis for a half
    turn."""
    real = 1.0 + (a * b).sum(-1, keepdim=True)
    axis = torch.linalg.cross(a, b)
    # Opposite vectors: any axis across a will do.
    other = torch.zeros_like(a)
    smallest = a.abs().argmin(-1, keepdim=True)
    other.scatter_(-1, smallest, 1.0)
    across = torch.linalg.cross(a, other)
    opposite = real < 1e-12
    real = torch.where(opposite, torch.zeros_like(real), real)
    axis = torch.where(opposite, across, axis)
    return normalise(torch.cat([real, axis], dim=-1))
