"""Ropes as compiled code takes them: the fields of a table as arrays with one row a rope."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ropefit.rod.either import Array
from ropefit.rod.fields import Field, shapes
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.shapes import check_shapes


def rod_rows(rod: Mapping[str, Array], fields: tuple[Field, ...]) -> dict[str, np.ndarray]:
    """Return the fields as arrays (R, ...), or (1, ...) of what is the same in all ropes."""
    arrays = {}
    for field in fields:
        value = rod[field.name]
        arrays[field.name] = as_numpy(value if value.ndim > len(field.shape) else value[None])
    return arrays


def rod_arrays(rod: Mapping[str, Array], fields: tuple[Field, ...]) -> dict[str, np.ndarray]:
    """Return the fields as arrays (R, ...); what has no dimension of ropes is the same for all."""
    arrays = rod_rows(rod, fields)
    ropes = max(map(len, arrays.values()))
    return {name: every_row(array, ropes) for name, array in arrays.items()}


def every_row(array: np.ndarray, count: int) -> np.ndarray:
    """Return an array with a row for each of `count` ropes."""
    return array if len(array) == count else np.repeat(array, count, axis=0)


def sum_of_ropes(
    gradient: np.ndarray, of: np.ndarray, ropes: int, shape: tuple[int, ...]
) -> np.ndarray:
    """Return a gradient (F, ...) summed over the frames, or clips, that show each of R ropes, of
    (F,); in the shape of the field: over all ropes where it is the same in all."""
    total = np.zeros((ropes, *gradient.shape[1:]))
    np.add.at(total, of, gradient)
    whole = total if total.size == math.prod(shape) else total.sum(axis=0)
    return whole.reshape(shape)


def whole_rest(rest: np.ndarray) -> np.ndarray:
    """Return the rest Darboux quaternions (R, N+1, 4) of vector parts (R, N+1, 3)."""
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1, keepdims=True), 0.0))
    return np.concatenate([real, rest], -1)


def free_to_spin(stiffness: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return (R,) bool: no twist held, no rest curvature, no direction of easier bending."""
    spins = (
        (stiffness[:, 0, 2] == 0) & (stiffness[:, -1, 2] == 0) & (rest[:, :, :2] == 0).all((1, 2))
    )
    return spins & (stiffness[:, :, 0] == stiffness[:, :, 1]).all(1)


def check_rods(rods: Any, fields: tuple[Field, ...]) -> None:
    """Check a record of R ropes, its rest the whole quaternion. Raises ShapeError."""
    ropes, segments = rods.length.shape
    wanted = shapes(fields, segments) | {"rest": (segments + 1, 4), "gauge": ()}
    check_shapes(**{
        name: (getattr(rods, name), (ropes, *shape)) for name, shape in wanted.items()
    })  # fmt: skip
