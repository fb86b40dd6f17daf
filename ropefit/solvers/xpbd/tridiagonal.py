"""The Thomas algorithm for many ropes at once, differentiable.

All chains of a batch are laid end to end with zero coupling between them: one LAPACK call
(`dptsv`, the
Thomas recurrence for a positive definite matrix) solves them all in linear time. The derivative is
one more solve with the same matrix.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.linalg.lapack import dptsv  # type: ignore[attr-defined]
from torch import Tensor


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx, diagonal: Tensor, off: Tensor, right: Tensor) -> Tensor:
        solution = _solve(diagonal, off, right)
        ctx.save_for_backward(diagonal, off, solution)
        return solution

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads: Tensor):
        diagonal, off, solution = ctx.saved_tensors
        adjoint = _solve(diagonal, off, grads[0])
        cross = adjoint[..., 1:] * solution[..., :-1] + adjoint[..., :-1] * solution[..., 1:]
        return -adjoint * solution, -cross, adjoint


def _solve(diagonal: Tensor, off: Tensor, right: Tensor) -> Tensor:
    n = diagonal.shape[-1]
    d = diagonal.detach().numpy().reshape(-1, n)
    b = right.detach().numpy().reshape(-1, n)
    e = np.zeros_like(d)
    e[:, :-1] = off.detach().numpy().reshape(-1, n - 1)
    # A rope that blew up must not poison its neighbours in the concatenated system.
    bad = ~(np.isfinite(d).all(1) & np.isfinite(e).all(1) & np.isfinite(b).all(1))
    if bad.any():
        d, e, b = d.copy(), e.copy(), b.copy()
        d[bad], e[bad], b[bad] = 1.0, 0.0, 0.0
    _, _, solution, info = dptsv(d.ravel(), e.ravel()[:-1], b.ravel())
    if info != 0:
        raise ArithmeticError("tridiagonal matrix is not positive definite")
    solution = solution.reshape(-1, n)
    solution[bad] = np.nan
    return torch.from_numpy(solution.reshape(tuple(right.shape)))


def solve_tridiagonal(diagonal: Tensor, off: Tensor, right: Tensor) -> Tensor:
    """Solve A y = right for symmetric positive definite tridiagonal A, batched.

    diagonal (..., n), off (..., n-1), right (..., n), float64 on the CPU; returns (..., n). Rows
    with NaN or infinity return NaN and leave the others alone.
    """
    diagonal, off, right = torch.broadcast_tensors(
        diagonal, torch.nn.functional.pad(off, (0, 1)), right
    )
    return _Solve.apply(diagonal, off[..., :-1], right)  # type: ignore[return-value]
