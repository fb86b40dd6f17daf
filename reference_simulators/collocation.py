"""Boundary-value problems of many frames at once, by Hermite-Simpson collocation (fourth order).

The same formula as `scipy.integrate.solve_bvp` (Lobatto IIIA with cubic elements), with exact
derivatives, the mesh and the jumps of point loads given, and LAPACK's banded solver.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Array = NDArray[np.float64]


class Problem(Protocol):
    """y' = f(s, y) on elements, jumps at the left node of elements, conditions at both ends.

    `frames` says which of the problem's frames the rows of y are.
    """

    @property
    def mesh(self) -> Array:
        """Return the arc lengths (N + 1,) [m]."""
        ...

    def slope(self, y: Array) -> tuple[Array, Array]:
        """Return f (T, N, n) and its derivative (T, N, n, n) at y (T, N, n).

        One point in each element.
        """
        ...

    def jump(self, y: Array) -> tuple[Array, dict[int, Array]]:
        """Return y (T, N, n) just behind the left nodes; derivatives (T, n, n) if any."""
        ...

    def ends(self, frames: NDArray[np.int_], first: Array, last: Array) -> tuple[Array, Array]:
        """Return the residuals of the end conditions: (T, n_left), (T, n_right); complex-safe."""
        ...


class NotConverged(RuntimeError):
    """Newton's method did not reach a solution."""


def residual(problem: Problem, frames: NDArray[np.int_], y: Array) -> Array:
    """Return the residual (T, (N + 1) n)."""
    return _assemble(problem, frames, y, derivative=False)[0]


def _assemble(
    problem: Problem, frames: NDArray[np.int_], y: Array, derivative: bool
) -> tuple[Array, Array, int]:
    """Return the residual (T, m), banded matrix (T, bands, m) and the number of upper bands."""
    count, nodes, n = y.shape
    h = np.diff(problem.mesh)[:, None]
    left, turned = problem.jump(y[:, :-1])
    right = y[:, 1:]
    f0, a0 = problem.slope(left)
    f1, a1 = problem.slope(right)
    fm, am = problem.slope(0.5 * (left + right) + h / 8 * (f0 - f1))
    inside = right - left - h / 6 * (f0 + 4 * fm + f1)
    first, last = problem.ends(frames, y[:, 0], y[:, -1])
    out = np.concatenate([first, inside.reshape(count, -1), last], axis=1)
    if not derivative:
        return out, np.empty(0), 0

    eye, hh = np.eye(n), h[:, :, None]
    by_right = eye - hh / 6 * (a1 + 4 * am @ (0.5 * eye - hh / 8 * a1))
    by_left = -eye - hh / 6 * (a0 + 4 * am @ (0.5 * eye + hh / 8 * a0))
    for element, factor in turned.items():
        by_left[:, element] = by_left[:, element] @ factor
    head = first.shape[1]
    lower, upper = head + n - 1, 2 * n - 1 - head
    lower, upper = max(lower, n - 1), max(upper, n - 1)
    band = np.zeros((count, lower + upper + 1, nodes * n))
    rows = head + np.arange((nodes - 1) * n).reshape(nodes - 1, n, 1)
    columns = np.arange((nodes - 1) * n).reshape(nodes - 1, 1, n)
    band[:, upper + rows - columns, columns + 0 * rows] = by_left
    band[:, upper + rows - columns - n, columns + n + 0 * rows] = by_right
    step = 1e-30
    for j in range(n):
        moved = 1j * step * eye[j]
        a, _ = problem.ends(frames, y[:, 0] + moved, y[:, -1])
        _, b = problem.ends(frames, y[:, 0], y[:, -1] + moved)
        row = np.arange(head)
        band[:, upper + row - j, j] = np.imag(a) / step
        row, column = nodes * n - n + head + np.arange(n - head), (nodes - 1) * n + j
        band[:, upper + row - column, column] = np.imag(b) / step
    return out, band, upper


def solve(problem: Problem, y: Array, tolerance: float = 1e-10, most: int = 25) -> Array:
    """Solve by damped Newton, frame by frame: return (T, N + 1, n) next to `y`.

    `tolerance` bounds the last step, over the largest of each component. Raises NotConverged.
    """
    y = y.copy()
    left = np.arange(len(y))
    scale = np.maximum(np.abs(y).max(axis=(0, 1)), 1e-6)
    for _ in range(most):
        out, band, upper = _assemble(problem, left, y[left], derivative=True)
        lower = band.shape[1] - upper - 1
        steps = np.stack(
            [
                solve_banded((lower, upper), b, r, overwrite_ab=True, check_finite=False)
                for b, r in zip(band, out, strict=True)
            ]
        ).reshape(len(left), *y.shape[1:])
        if not np.isfinite(steps).all():
            raise NotConverged("singular")
        size = np.abs(steps / scale).max(axis=(1, 2))
        # Long steps leave the region of convergence: quaternions may move by about 0.3 at once.
        damping = np.minimum(1.0, 0.5 / np.maximum(np.abs(steps[..., 3:7]).max(axis=(1, 2)), 1e-12))
        y[left] -= damping[:, None, None] * steps
        left = left[size > tolerance]
        if len(left) == 0:
            return y
        if not np.isfinite(y).all() or np.abs(y[left]).max() > 1e6:
            break
    raise NotConverged(f"{len(left)} frames")


def derivatives(problem: Problem, y: Array, changed: Sequence[Problem]) -> Array:
    """Return the first-order change (T, C, N + 1, n) of the solution `y` under changed problems.

    The changes must be small and keep the mesh.
    """
    frames = np.arange(len(y))
    out, band, upper = _assemble(problem, frames, y, derivative=True)
    lower = band.shape[1] - upper - 1
    right = np.stack([residual(other, frames, y) - out for other in changed], axis=2)
    found = [
        -solve_banded((lower, upper), b, r, check_finite=False)
        for b, r in zip(band, right, strict=True)
    ]
    return np.moveaxis(np.stack(found), 2, 1).reshape(len(y), len(changed), *y.shape[1:])
