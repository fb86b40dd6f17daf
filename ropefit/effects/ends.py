"""The two ends of a rope: values at one of them, a turned clamp, and what they are called."""

from __future__ import annotations

import numpy as np

from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup


def one_end(end: int, value: np.ndarray) -> np.ndarray:
    """Return (2, ...) with value (...) at one end and zero at the other."""
    zero = np.zeros_like(value)
    return np.stack([value, zero] if end == 0 else [zero, value])


def turned_clamp(setup: Setup, end: int, turn: np.ndarray) -> Setup:
    """Return the setup with one end's clamp turned by turn (3,) [rad] about its own axes."""
    clamp = setup.clamp.copy()
    clamp[:, end] = multiply(clamp[:, end], from_rotation_vector(turn))
    return setup._replace(clamp=clamp)


def where(end: int) -> str:
    """Return an end in words."""
    return "the gripper's end (end 0)" if end == 0 else "the other end (end 1)"
