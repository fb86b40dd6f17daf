"""What works for numpy's arrays and for tensors alike: all that torch may differentiate."""

from __future__ import annotations

from typing import Any

import numpy as np
from array_api_compat import array_namespace, device, is_torch_array

Array = Any  # of numpy; a tensor where gradients are asked for
NUMPY = array_namespace(np.empty(0))


def namespace(*arrays: Array) -> Any:
    """Return the library that arrays are of, in the array API's terms: of numpy's at once, as small
    ones are asked for a million times."""
    return NUMPY if _of_numpy(*arrays) else array_namespace(*arrays)


def _of_numpy(*arrays: Any) -> bool:
    return all(type(array) is np.ndarray for array in arrays)


def like(values: Any, array: Array) -> Array:
    """Return values as an array of the same library, type and device as another."""
    if _of_numpy(values, array) and values.dtype == array.dtype:
        return values
    if is_torch_array(values):
        return values.to(array)
    xp = namespace(array)
    return xp.asarray(values, dtype=array.dtype, device=device(array))


def alike(*values: Any) -> list[Array]:
    """Return numbers and arrays as float64 arrays of one library: tensors, if any of them is."""
    tensor = next((v for v in values if is_torch_array(v)), None)
    if tensor is None:
        return [np.asarray(v, dtype=np.float64) for v in values]
    return [like(v, tensor.double()) for v in values]


def plain(array: Array) -> np.ndarray:
    """Return the numpy array that a tensor is of, or the array itself."""
    return array.detach().numpy() if hasattr(array, "detach") else array


def broadcast_to(array: Array, shape: tuple[int, ...]) -> Array:
    """Return a view of an array in a larger shape."""
    return namespace(array).broadcast_to(array, shape)
