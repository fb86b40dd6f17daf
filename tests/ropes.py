"""Ropes that several tests use."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.strains import Rest, straight_rest
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.reference import Eta, State

GRAVITY = np.array([0.0, 0.0, -9.81])
DOWN = torch.from_numpy(GRAVITY)
ETA = (0.04, 0.9, 0.8, 0.7, 0.6, 0.9)


def eta(values: tuple[float, ...] = ETA) -> Eta:
    """The six weights as scalars."""
    return Eta(*(torch.tensor(value, dtype=torch.float64) for value in values))


def hanging(
    frames: int = 3, nodes: int = 12, held: tuple[int, ...] = (0, -1), apart: float = 0.6
) -> tuple[State, Rest, Chain]:
    """Disturbed catenaries of a 1 m rope, ends `apart` to 0.9 m from each other."""
    rng = np.random.default_rng(3)
    x = np.empty((frames, nodes, 3))
    for t, distance in enumerate(np.linspace(apart, 0.9, frames)):
        ends = np.array([[0.0, 0.0, 0.5], [distance, 0.1, 0.55]])
        x[t] = hanging_shape(1.0, nodes, GRAVITY, ends, np.full((2, 3), np.nan))
    x[:, 1:-1] += 0.004 * rng.normal(size=x[:, 1:-1].shape)
    q = frames_along(x)
    q = multiply(q, from_rotation_vector(0.1 * rng.normal(size=(*q.shape[:-1], 3))))
    mask = torch.zeros(nodes, dtype=torch.bool)
    mask[list(held)] = True
    chain = Chain.build(mask, torch.zeros(nodes - 1, dtype=torch.bool))
    return State(torch.from_numpy(x), torch.from_numpy(q)), straight_rest(1.0, nodes), chain


def central_difference(function, value: Tensor, direction: Tensor, step: float) -> float:
    """Fourth-order central difference of a scalar function along a direction."""
    f = [float(function(value + k * step * direction)) for k in (-2, -1, 1, 2)]
    return (f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * step)
