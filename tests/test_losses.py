"""L_PL, L_SP, L_SL, L_LO and OBJ1-OBJ9 against brute force on random data."""

import numpy as np
import pytest
import torch

from ropefit.losses.objectives import OBJECTIVES, Pinhole, Scene
from ropefit.losses.primary import Observed

F, N, K = 3, 25, 8
DOWN = np.array([0.0, 0.0, -1.0])


def to_segment(p, a, b):
    """Distance from p to the segment a-b by dense search and by projection; the smaller."""
    t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    dense = min(np.linalg.norm(p - (a + s * (b - a))) for s in np.linspace(0, 1, 101))
    exact = np.linalg.norm(p - (a + t * (b - a)))
    assert exact <= dense + 1e-12
    return exact


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(5)
    x = np.cumsum(rng.normal(0.05, 0.05, (2, F, K, 3)), axis=2)
    mask = rng.random((F, N)) < 0.8
    boundary_mask = rng.random((F, K)) < 0.8
    segment = rng.integers(0, K - 1, (F, N))
    space = rng.normal(0.2, 0.2, (F, N, 3)), rng.normal(0.2, 0.2, (F, K, 3))
    image = rng.normal(300, 80, (F, N, 2)), rng.normal(300, 80, (F, K, 2))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    origin = -2.0 * rotation[:, 2]
    size = rng.uniform(0.001, 0.003, F)
    lowest = rng.normal(size=(F, 3))
    camera = Pinhole(np.array([500.0, 520.0]), np.array([320.0, 180.0]), rotation, origin)

    def observed(points, boundaries):
        return Observed(points, mask, segment, boundaries, boundary_mask)

    scene = Scene(observed(*space), observed(*image), camera, size, lowest, DOWN)
    return x, mask, boundary_mask, segment, space, image, camera, size, lowest, scene


def project(camera, x):
    focal, centre, rotation, origin = camera
    local = (x - origin) @ rotation
    return local[..., :2] / local[..., 2:] * focal + centre


def primary(kind, x, points, boundaries, mask, boundary_mask, segment):
    """One frame's loss, loop by loop."""
    if kind == "PL":
        return sum(min(to_segment(p, x[k], x[k + 1]) for k in range(K - 1)) for p in points[mask])
    if kind == "SP":
        return sum(np.linalg.norm(boundaries[i] - x[i]) for i in range(K) if boundary_mask[i])
    return sum(
        to_segment(p, x[s], x[s + 1]) for p, s in zip(points[mask], segment[mask], strict=True)
    )


TABLE = {
    "OBJ1": ("PL", False, False), "OBJ2": ("PL", True, False), "OBJ3": ("PL", True, True),
    "OBJ4": ("SP", False, False), "OBJ5": ("SP", True, False), "OBJ6": ("SP", True, True),
    "OBJ7": ("SL", False, False), "OBJ8": ("SL", True, False), "OBJ9": ("SL", True, True),
}  # fmt: skip


@pytest.mark.parametrize("name", TABLE)
def test_objective_equals_brute_force(name, data):
    x, mask, boundary_mask, segment, space, image, camera, size, lowest, scene = data
    kind, flat, low = TABLE[name]
    got = OBJECTIVES[name].loss(x, scene)
    assert got.shape == (2, F)
    of_tensors = OBJECTIVES[name].loss(torch.from_numpy(x), scene.tensors())
    np.testing.assert_allclose(of_tensors, got, rtol=1e-12)
    for c in range(2):
        for f in range(F):
            rope = project(camera, x[c, f]) if flat else x[c, f]
            points, boundaries = (item[f] for item in (image if flat else space))
            want = primary(kind, rope, points, boundaries, mask[f], boundary_mask[f], segment[f])
            want *= size[f] if flat else 1.0
            if low:
                want += np.linalg.norm(lowest[f] - x[c, f, np.argmax(x[c, f] @ DOWN)])
            assert got[c, f] == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize("name", TABLE)
def test_objective_gradient(name, data):
    x, scene = torch.from_numpy(data[0]), data[-1].tensors()
    direction = torch.from_numpy(np.random.default_rng(1).normal(size=data[0].shape))
    objective = OBJECTIVES[name]
    value = x.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(objective.loss(value, scene).sum(), value)
    step = 1e-6
    numeric = (
        objective.loss(x + step * direction, scene).sum()
        - objective.loss(x - step * direction, scene).sum()
    ) / (2 * step)
    assert float((gradient * direction).sum()) == pytest.approx(float(numeric), rel=1e-6)


def test_perfect_agreement_is_zero_with_zero_gradient(data):
    scene = data[-1].tensors()
    x = torch.from_numpy(data[0][0]).requires_grad_()
    points = torch.cat([x.detach()] * 4, dim=1)[:, :N]
    exact = scene.space._replace(points=points, boundaries=x.detach())
    for name in ("OBJ1", "OBJ4"):
        loss = OBJECTIVES[name].loss(x, scene._replace(space=exact))
        assert float(loss.sum().detach()) < 1e-12
        (gradient,) = torch.autograd.grad(loss.sum(), x)
        assert torch.isfinite(gradient).all()


def test_degenerate_polyline_gives_no_nan(data):
    scene = data[-1].tensors()
    x = torch.zeros(F, K, 3, dtype=torch.float64, requires_grad=True)
    for name in TABLE:
        loss = OBJECTIVES[name].loss(x, scene).sum()
        (gradient,) = torch.autograd.grad(loss, x)
        assert torch.isfinite(loss)
        assert torch.isfinite(gradient).all()
