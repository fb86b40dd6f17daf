"""Random smooth paths of the ends of ropes, frame after frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply, normalise

NEAREST, FARTHEST = 0.02, 0.999  # m, of the ends of a rope of 1 m


class Paths(NamedTuple):
    """C motions of T frames: ends (C, T, 2, 3) [m], frames of the clamps (C, T, 2, 4), without
    jumps of sign, and the most that either end turns from one frame to the next (C,) [rad]."""

    ends: Tensor
    clamp: Tensor
    turn: np.ndarray


def paths(
    rng: np.random.Generator, count: int, time: np.ndarray, amplitude: np.ndarray, quickest: float
) -> Paths:
    """Random paths for ropes of 1 m at times (T,) or (C, T): how far apart the ends are, in which
    direction, where, and either clamp's turn; up to `quickest` swings per unit of time.

    amplitude (C,): 1 turns the clamps by about a radian each way, leads the ends by half a metre.
    """
    swing = _Swings(rng, count, time, quickest)
    apart = rng.uniform(-3, 3, count)[:, None] + 3 * amplitude[:, None] * swing(1)[..., 0]
    apart = NEAREST + (FARTHEST - NEAREST) / (1 + np.exp(-apart))
    direction = rng.normal(size=(count, 1, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    wide = amplitude[:, None, None]
    direction = _turned(direction, wide * swing(3))
    first = 0.5 * wide * swing(3)
    ends = np.stack([first, first + apart[..., None] * direction], axis=2)
    at_rest = normalise(torch.from_numpy(rng.normal(size=(count, 1, 2, 4))))
    turn = wide[..., None] * np.stack([swing(3), swing(3)], axis=2)
    clamp = multiply(from_rotation_vector(torch.from_numpy(turn)), at_rest)
    along = (clamp[:, 1:] * clamp[:, :-1]).sum(-1).clamp(-1, 1)
    step = 2 * torch.arccos(along).amax((1, 2))
    return Paths(torch.from_numpy(ends), clamp, step.numpy())


class _Swings:
    """Sines of random frequency and phase."""

    def __init__(self, rng, count: int, time: np.ndarray, quickest: float):
        self.rng, self.count, self.time, self.quickest = rng, count, time, quickest

    def __call__(self, many: int) -> np.ndarray:
        """(C, T, many) between -1 and 1."""
        shape = (self.count, 1, many)
        rate = 2 * np.pi * self.quickest * self.rng.uniform(0.2, 1.0, shape)
        phase = self.rng.uniform(0, 2 * np.pi, shape)
        return np.sin(rate * np.atleast_2d(self.time)[..., None] + phase)


def _turned(vector: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(..., 3) vectors turned by rotation vectors [rad]: Rodrigues' formula."""
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    axis = turn / np.maximum(angle, 1e-300)
    across = np.cross(axis, vector)
    along = (axis * vector).sum(-1, keepdims=True) * axis
    return np.cos(angle) * vector + np.sin(angle) * across + (1 - np.cos(angle)) * along
