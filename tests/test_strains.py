"""C^S, C^B, C^D: values on shapes with known strain, gradients, degenerate input."""

import pytest
import torch
from jaxtyping import TypeCheckError

from ropefit.rod.quaternion import director, from_rotation_vector, normalise
from ropefit.rod.strains import Rest, bend_twist, distance, straight_rest, stretch_shear

F64 = torch.float64


def random_state(nodes: int = 7) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    x = torch.randn(2, nodes, 3, generator=generator, dtype=F64)
    q = normalise(torch.randn(2, nodes - 1, 4, generator=generator, dtype=F64))
    return x, q


def test_stretched_straight_rope_has_pure_stretch():
    rest = straight_rest(1.0, 5)
    x = torch.zeros(5, 3, dtype=F64)
    x[:, 2] = 1.1 * torch.linspace(0, 1, 5, dtype=F64)
    q = torch.tensor([1.0, 0, 0, 0], dtype=F64).expand(4, 4)
    value = stretch_shear(x[1:] - x[:-1], q, rest).value
    assert torch.allclose(value, torch.tensor([0, 0, 0.1], dtype=F64).expand(4, 3))
    assert torch.allclose(distance(x[1:] - x[:-1], rest).value, torch.full((4,), 0.025, dtype=F64))


def test_uniform_twist_and_bend_are_half_the_angle():
    """Im(q_i* q_{i+1}) of a turn by a about a fixed axis is sin(a/2) along that axis."""
    rest = straight_rest(1.0, 8)
    for axis in range(3):
        turn = torch.zeros(7, 3, dtype=F64)
        turn[:, axis] = 0.2 * torch.arange(7, dtype=F64)
        value = bend_twist(from_rotation_vector(turn), rest).value
        want = torch.zeros(6, 3, dtype=F64)
        want[:, axis] = torch.sin(torch.tensor(0.1, dtype=F64))
        assert torch.allclose(value, want, atol=1e-14)


def test_rest_darboux_is_strain_free_for_both_signs():
    """q and -q are one frame: flipping the sign of a frame must not make strain."""
    turn = torch.zeros(7, 3, dtype=F64)
    turn[:, 0] = 0.9 * torch.arange(7, dtype=F64)
    q = from_rotation_vector(turn)
    half = torch.tensor(0.45, dtype=F64)
    darboux = torch.zeros(6, 4, dtype=F64)
    darboux[:, 0], darboux[:, 1] = torch.cos(half), torch.sin(half)
    rest = Rest(torch.full((7,), 0.1, dtype=F64), darboux)
    assert bend_twist(q, rest).value.abs().max() < 1e-14
    flipped = q.clone()
    flipped[3] *= -1
    assert bend_twist(flipped, rest).value.abs().max() < 1e-14


def test_gradients_match_differentiation():
    x, q = random_state()
    rest = straight_rest(1.3, 7)
    edges = x[:, 1:] - x[:, :-1]
    shear, bend, stretch = stretch_shear(edges, q, rest), bend_twist(q, rest), distance(edges, rest)
    for b in range(2):
        for i in range(6):
            jac = torch.autograd.functional.jacobian(
                lambda v, b=b, i=i: stretch_shear(
                    edges[b, i : i + 1], v[None], rest._replace(length=rest.length[i : i + 1])
                ).value[0],
                q[b, i],
            )
            assert torch.allclose(shear.grad_q[b, i], jac, atol=1e-12)
            jac = torch.autograd.functional.jacobian(
                lambda v, i=i: distance(
                    v[None], rest._replace(length=rest.length[i : i + 1])
                ).value[0],
                edges[b, i],
            )
            assert torch.allclose(stretch.direction[b, i], jac, atol=1e-12)
        for i in range(5):
            one = rest._replace(darboux=rest.darboux[i : i + 1])
            first, second = torch.autograd.functional.jacobian(
                lambda p, r, one=one: bend_twist(torch.stack([p, r]), one).value[0],
                (q[b, i], q[b, i + 1]),
            )
            assert torch.allclose(bend.grad_first[b, i], first, atol=1e-12)
            assert torch.allclose(bend.grad_second[b, i], second, atol=1e-12)


def test_coincident_particles_have_a_finite_gradient():
    rest = straight_rest(1.0, 4)
    edges = torch.zeros(3, 3, dtype=F64, requires_grad=True)
    found = distance(edges, rest)
    assert torch.allclose(found.value, -rest.length)
    found.value.sum().backward()
    assert torch.isfinite(edges.grad).all()


def test_shapes_are_checked_while_tests_run():
    """The annotations of public functions are live here: a wrong shape is an error."""
    with pytest.raises(TypeCheckError):
        director(torch.zeros(5, 3, dtype=F64))
    with pytest.raises(TypeCheckError):
        stretch_shear(
            torch.zeros(4, 3, dtype=F64), torch.zeros(3, 4, dtype=F64), straight_rest(1.0, 5)
        )
