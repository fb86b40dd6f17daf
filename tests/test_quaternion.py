"""Frames: analytic references and properties."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ropefit.rod.quaternion import (
    conjugate_product,
    director,
    director_gradient,
    from_rotation_vector,
    multiply,
    normalise,
    smallest_rotation,
    transport,
)

angles = st.floats(-6, 6, allow_nan=False)
vectors = st.tuples(angles, angles, angles).map(lambda v: torch.tensor(v, dtype=torch.float64))
E3 = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


def rotation(q: torch.Tensor) -> torch.Tensor:
    """The rotation matrix written out, independent of the forms under test."""
    w, x, y, z = q.tolist()
    return torch.tensor(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
        dtype=torch.float64,
    )


@given(vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_director_is_third_column_of_rotation(v):
    q = from_rotation_vector(v)
    assert torch.allclose(director(q), rotation(q)[:, 2], atol=1e-12)


@given(vectors, vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_product_composes_rotations(a, b):
    p, q = from_rotation_vector(a), from_rotation_vector(b)
    assert torch.allclose(rotation(multiply(p, q)), rotation(p) @ rotation(q), atol=1e-12)
    assert torch.allclose(multiply(p, conjugate_product(p, q)), q, atol=1e-12)


def test_rotation_vector_is_matrix_exponential():
    v = torch.tensor([0.3, -1.1, 0.7], dtype=torch.float64)
    skew = torch.linalg.cross(torch.eye(3, dtype=torch.float64), v.expand(3, 3)).T
    assert torch.allclose(rotation(from_rotation_vector(v)), torch.matrix_exp(-skew), atol=1e-12)


def test_rotation_vector_gradient_at_zero_is_half():
    v = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(from_rotation_vector(v)[1], v)
    assert torch.allclose(gradient, torch.tensor([0.5, 0, 0], dtype=torch.float64))


def test_director_gradient_matches_differentiation():
    """Eq. (6), checked entry by entry by differentiation."""
    q = normalise(torch.tensor([0.4, -0.2, 0.7, 0.5], dtype=torch.float64))
    step = 1e-6 * torch.eye(4, dtype=torch.float64)
    numeric = (director(q + step) - director(q - step)).T / 2e-6
    assert torch.allclose(director_gradient(q), numeric, atol=1e-9)


@given(vectors, vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_smallest_rotation_takes_a_to_b(a, b):
    a, b = (normalise(v) if v.norm() > 1e-3 else E3 for v in (a, b))
    assert torch.allclose(rotation(smallest_rotation(a, b)) @ a, b, atol=1e-6)


def test_smallest_rotation_of_opposite_vectors_is_a_half_turn():
    q = smallest_rotation(E3, -E3)
    assert abs(float(q[0])) < 1e-12
    assert torch.allclose(rotation(q) @ E3, -E3, atol=1e-12)


@pytest.mark.parametrize("turns", [1, 2])
def test_transport_around_a_plane_circle_has_no_twist(turns):
    angle = torch.linspace(0, 2 * torch.pi * turns, 60, dtype=torch.float64)
    tangents = torch.stack([angle.cos(), torch.zeros_like(angle), angle.sin()], -1)
    q = transport(tangents)
    assert torch.allclose(director(q), tangents, atol=1e-12)
    relative = conjugate_product(q[:-1], q[1:])
    assert relative[:, 3].abs().max() < 1e-12  # no rotation about the tangent
