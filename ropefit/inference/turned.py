"""Tall least squares made small: residual and Jacobian turned until the residual has one row.

An optimiser needs of a residual z (M,) and its Jacobian J (M, P) only zᵀz, Jᵀz and JᵀJ. Both are
turned alike (QR), so that these stay as they are and to rounding nothing is lost, as it would be by
the normal equations themselves: the residual becomes (0, ..., 0, |z|), whatever J is, and the
Jacobian has P + 1 rows.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

AT_ONCE = 8192  # rows


def turned_residual(square: float, size: int) -> np.ndarray:
    """Return (P + 1,) the residual with a sum of squares, of `size` search variables."""
    return np.append(np.zeros(size), np.sqrt(square))


def turned_jacobian(parts: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return (P + 1, P) the Jacobian of a residual, turned with it; both in parts (M, P), (M,)."""
    both = np.empty(0)
    for jacobian, z in parts:
        size = jacobian.shape[1] + 1
        both = both if both.size else np.zeros((size, size))
        for k in range(0, len(z), AT_ONCE):
            few = slice(k, k + AT_ONCE)
            rows = np.column_stack([jacobian[few], z[few]])
            both = np.array(np.linalg.qr(np.concatenate([both, rows]), mode="r"))
    size = len(both)
    last = both[:, -1].copy()
    axis = np.append(np.zeros(size - 1), -np.copysign(np.linalg.norm(last), last[-1]))
    across = last - axis
    square = across @ across
    if square > 0:
        both -= np.outer(2 / square * across, across @ both)  # Householder's reflection
    if axis[-1] < 0:
        both[-1] *= -1
    return both[:, :-1]
