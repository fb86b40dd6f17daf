"""The two ends of a rope: values at one of them, a turned clamp, and what they are called."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.setup import Setup


def one_end(end: int, value: Tensor) -> Tensor:
    """Return (2, ...) with value (...) at one end and zero at the other."""
    zero = torch.zeros_like(value)
    return torch.stack([value, zero] if end == 0 else [zero, value])


def turned_clamp(setup: Setup, end: int, turn: Tensor) -> Setup:
    """Return the setup with one end's clamp turned by turn (3,) [rad] about its own axes."""
    wide = torch.zeros(2, 1, dtype=torch.bool)
    wide[end] = True
    turned = multiply(setup.clamp, from_rotation_vector(turn).expand_as(setup.clamp))
    return setup._replace(clamp=torch.where(wide, turned, setup.clamp))


def where(end: int) -> str:
    """Return an end in words."""
    return "the gripper's end (end 0)" if end == 0 else "the other end (end 1)"
