"""Frames: analytic references and properties."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from ropefit.rod.quaternion import (
    conjugate_product,
    director,
    director_gradient,
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
    smallest_rotation,
    transport,
)

angles = st.floats(-6, 6, allow_nan=False)
vectors = st.tuples(angles, angles, angles).map(np.array)
E3 = np.array([0.0, 0.0, 1.0])


def rotation(q: np.ndarray) -> np.ndarray:
    """The rotation matrix written out, independent of the forms under test."""
    w, x, y, z = q.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
    )


@given(vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_director_is_third_column_of_rotation(v):
    q = from_rotation_vector(v)
    assert np.allclose(director(q), rotation(q)[:, 2], atol=1e-12)


@given(vectors, vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_product_composes_rotations(a, b):
    p, q = from_rotation_vector(a), from_rotation_vector(b)
    assert np.allclose(rotation(multiply(p, q)), rotation(p) @ rotation(q), atol=1e-12)
    assert np.allclose(multiply(p, conjugate_product(p, q)), q, atol=1e-12)


def test_rotation_vector_is_matrix_exponential():
    v = np.array([0.3, -1.1, 0.7])
    skew = np.cross(np.eye(3), v).T
    assert np.allclose(rotation(from_rotation_vector(v)), expm(-skew), atol=1e-12)


def test_rotation_vector_gradient_at_zero_is_half():
    v = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(from_rotation_vector(v)[1], v)
    assert torch.allclose(gradient, torch.tensor([0.5, 0, 0], dtype=torch.float64))


def test_director_gradient_matches_differentiation():
    """Eq. (6), checked entry by entry by differentiation."""
    q = normalise(np.array([0.4, -0.2, 0.7, 0.5]))
    step = 1e-6 * np.eye(4)
    numeric = (director(q + step) - director(q - step)).T / 2e-6
    assert np.allclose(director_gradient(q), numeric, atol=1e-9)


@given(vectors, vectors)
@settings(max_examples=50, deadline=None, derandomize=True)
def test_smallest_rotation_takes_a_to_b(a, b):
    a, b = (normalise(v) if np.linalg.norm(v) > 1e-3 else E3 for v in (a, b))
    assert np.allclose(rotation(smallest_rotation(a, b)) @ a, b, atol=1e-6)


def test_smallest_rotation_of_opposite_vectors_is_a_half_turn():
    q = smallest_rotation(E3, -E3)
    assert abs(float(q[0])) < 1e-12
    assert np.allclose(rotation(q) @ E3, -E3, atol=1e-12)


@pytest.mark.parametrize("turns", [1, 2])
def test_transport_around_a_plane_circle_has_no_twist(turns):
    angle = np.linspace(0, 2 * np.pi * turns, 60)
    tangents = np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], -1)
    q = transport(tangents)
    assert np.allclose(director(q), tangents, atol=1e-12)
    relative = conjugate_product(q[:-1], q[1:])
    assert np.abs(relative[:, 3]).max() < 1e-12  # no rotation about the tangent


@pytest.mark.parametrize("count", [1, 2, 3, 8, 21])
def test_transport_turns_each_frame_by_the_smallest_rotation(count):
    tangents = normalise(np.random.default_rng(count).normal(size=(4, count, 3)))
    q = transport(tangents)
    for i in range(1, count):
        turn = smallest_rotation(tangents[:, i - 1], tangents[:, i])
        np.testing.assert_allclose(q[:, i], multiply(turn, q[:, i - 1]), rtol=0, atol=1e-14)


def test_tensors_give_what_arrays_do():
    rng = np.random.default_rng(0)
    v, w = rng.normal(size=(2, 7, 3))
    p, q = from_rotation_vector(v), from_rotation_vector(w)
    for function, arguments in [
        (from_rotation_vector, (v,)), (conjugate_product, (p, q)), (multiply, (p, q)),
        (rotate, (p, w)), (director, (p,)), (director_gradient, (p,)), (normalise, (w,)),
        (smallest_rotation, (normalise(v), normalise(w))), (transport, (normalise(v), q[0])),
    ]:  # fmt: skip
        found = function(*map(torch.from_numpy, arguments))
        np.testing.assert_allclose(found, function(*arguments), rtol=0, atol=1e-14)
