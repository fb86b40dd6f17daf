"""The batched search on functions with known minima."""

import torch

from ropefit.inference import bfgs
from ropefit.inference.bfgs import begin, step, stop_at_limit


def run(function, u, most=300, **options):
    search = begin(function, u)
    while search.running and search.evaluations < most:
        step(function, search, **options)
    stop_at_limit(search)
    return search


def start(*rows):
    return torch.tensor(rows, dtype=torch.float64)


def test_rosenbrock_from_several_starts():
    def function(u, rows):
        return 100 * (u[:, 1] - u[:, 0] ** 2) ** 2 + (1 - u[:, 0]) ** 2

    search = run(function, start([-1.2, 1.0], [2.0, -1.0], [0.0, 0.0]), tolerance=1e-12)
    assert search.converged.all()
    assert torch.allclose(search.u, torch.ones(3, 2, dtype=torch.float64), atol=1e-4)


def test_kinks_are_recognised_as_minima():
    """A sum of norms is least at a data point, where its gradient does not vanish."""
    points = start([0.0, 0.0], [1.0, 0.1], [-0.7, 0.3], [0.1, -1.0])

    def function(u, rows):
        square = ((u[:, None, :] - points) ** 2).sum(-1)
        return torch.sqrt(torch.where(square > 0, square, 1.0)).where(square > 0, 0.0).sum(1)

    search = run(function, start([0.4, 0.5], [0.0, 0.0]))
    assert search.converged.all()
    best = min(float(function(p[None], None)) for p in points)
    assert torch.allclose(search.loss, torch.full((2,), best, dtype=torch.float64), rtol=1e-2)


def test_rows_are_independent_and_bad_ones_are_marked():
    def function(u, rows):
        value = ((u - rows[:, None]) ** 2).sum(1)
        return torch.where(rows == 1, torch.nan, value)

    search = run(function, start([5.0, 5.0], [5.0, 5.0], [5.0, 5.0]))
    assert search.converged.tolist() == [True, False, True]
    assert int(search.status[1]) == bfgs.DIVERGED
    assert torch.allclose(search.u[2], torch.full((2,), 2.0, dtype=torch.float64), atol=1e-3)


def test_evaluation_limit_is_not_convergence():
    search = run(lambda u, rows: (u**4).sum(1), start([50.0]), most=3)
    assert not search.converged.any()
    assert int(search.status[0]) == bfgs.LIMIT


def test_steps_into_infinity_are_shortened():
    def function(u, rows):
        return torch.where(u[:, 0] < 1.0, (u[:, 0] - 0.99) ** 2, torch.inf)

    search = run(function, start([-3.0]), tolerance=1e-10)
    assert abs(float(search.u[0, 0]) - 0.99) < 1e-3
