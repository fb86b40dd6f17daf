"""Checks of array shapes before compiled code, which does not check its own indices.

Every kernel's arguments pass through here once a call; a mistake is an exception, never a write
past the end of an array.
"""

from __future__ import annotations

import numpy as np


class ShapeError(ValueError):
    """Arrays that do not belong together were given to a solver: a mistake in the code."""


def check_shapes(**arrays: tuple[np.ndarray, tuple[int, ...]]) -> None:
    """Check arrays, each given by name with the shape that it must have. Raises ShapeError."""
    for name, (array, shape) in arrays.items():
        if tuple(array.shape) != shape:
            raise ShapeError(f"{name} has shape {tuple(array.shape)}, not {shape}")


def check_indices(name: str, index: np.ndarray, size: int) -> None:
    """Check that indices (n,) are those of an axis of this size. Raises ShapeError."""
    if len(index) and not (index.min() >= 0 and index.max() < size):
        raise ShapeError(f"{name} points outside an axis of {size}")
