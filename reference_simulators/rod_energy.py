"""The potential energy of a rod, as the paper's strains give it: the physics in one place.

The solvers find its minimum by other, faster means; tests hold them to this.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.quaternion import conjugate_product, director_gradient, multiply
from ropefit.rod.rod import Rod

Item = TypeVar("Item")


def tensors(item: Item) -> Item:
    """Return an array, or all those in a record, as tensors; what are tensors already stay."""
    if isinstance(item, tuple):
        return type(item)(*map(tensors, item))
    return torch.tensor(item) if isinstance(item, np.ndarray) else item  # type: ignore[return-value]


def energy(rod: Rod, x: Tensor, q: Tensor, clamp: Tensor) -> Tensor:
    """Return the energy (...,) [J] of nodes x (..., N+1, 3) [m] and frames q (..., N, 4).

    clamp (..., 2, 4): frames held at the ends (anything where the rod is not clamped).

        Σ l/2 (GA Γ1² + GA Γ2² + EA Γ3²) + Σ k/2 |Im(p) - rest|² - Σ load · x

    with Γ the stretch-shear strain C^S in the segment's own frame and p the rotation between
    neighbouring frames (C^B). EA and GA must be finite.
    """
    rod = tensors(rod)
    edge = (x[..., 1:, :] - x[..., :-1, :]) / rod.length[..., None]
    strain = own(q, edge - 0.5 * (director_gradient(q) @ q[..., None])[..., 0])
    stretch = 0.5 * (rod.length[..., None] * strain**2 / rod.flexibility).sum((-1, -2))
    around = torch.cat([clamp[..., :1, :], q, clamp[..., 1:, :]], dim=-2)
    p = conjugate_product(around[..., :-1, :], around[..., 1:, :])
    real = torch.sqrt((1 - (rod.rest**2).sum(-1)).clamp_min(0.0))
    nearer = p[..., 0] * real + (p[..., 1:] * rod.rest).sum(-1)
    vector = torch.where(nearer < 0, -1.0, 1.0)[..., None] * p[..., 1:]
    bend = 0.5 * (rod.stiffness * (vector - rod.rest) ** 2).sum((-1, -2))
    return stretch + bend - (rod.load * x).sum((-1, -2))


def own(q: Tensor, vector: Tensor) -> Tensor:
    """Return (..., 3) a vector in space as the frame q has it: R(q)ᵀ v."""
    sign = torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=q.dtype, device=q.device)
    wide = torch.nn.functional.pad(vector, (1, 0))
    return multiply(multiply(q * sign, wide), q)[..., 1:]
