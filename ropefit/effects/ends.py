"""The two ends of a rope: values at one of them, a turned clamp, and what they are called."""

from __future__ import annotations

import numpy as np

from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup

NEXT_TO_END = 0.03  # of the length: places are told no better


def end_next_to(share: float) -> int | None:
    """Return which end a place, a share of the length, is next to, if any."""
    near = [share < NEXT_TO_END, share > 1 - NEXT_TO_END]
    return near.index(True) if any(near) else None


def one_end(end: int, value: np.ndarray) -> np.ndarray:
    """Return (2, ...) with value (...) at one end and zero at the other."""
    out = np.zeros((2, *np.shape(value)))
    out[end] = value
    return out


def turned_clamp(setup: Setup, end: int, turn: np.ndarray) -> Setup:
    """Return the setup with one end's clamp turned by turn (3,) [rad] about its own axes."""
    clamp = setup.clamp.copy()
    clamp[:, end] = multiply(clamp[:, end], from_rotation_vector(turn))
    return setup._replace(clamp=clamp)


def where(end: int) -> str:
    """Return an end in words."""
    return "the gripper's end (end 0)" if end == 0 else "the other end (end 1)"
