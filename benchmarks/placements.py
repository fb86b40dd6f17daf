"""Random ropes and end placements, and an answer to whether a state is in equilibrium that shares
no code with the solver."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.energy import energy
from ropefit.rod.quaternion import director, normalise
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution


class Placements(NamedTuple):
    """F ropes, each in one frame; bend (F,) is EI/(ρ g L³), apart (F,) |a-b|/L."""

    rod: Rod
    conditions: Conditions
    bend: np.ndarray
    apart: np.ndarray


def placements(count: int, clamped: bool, nodes: int = 20, seed: int = 0) -> Placements:
    """Inextensible ropes of 1 m and 1 N: ends 0.02 to 0.999 m apart in any direction, EI 1e-6 to
    1e-1 N m² (logarithmically uniform), clamps in any orientation."""
    rng = np.random.default_rng(seed)
    apart, bend = rng.uniform(0.02, 0.999, count), 10 ** rng.uniform(-6, -1, count)
    direction = rng.normal(size=(count, 3))
    ends = torch.zeros(count, 2, 3, dtype=torch.float64)
    ends[:, 1] = torch.from_numpy(
        apart[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    )
    clamp = torch.full((count, 2, 4), torch.nan, dtype=torch.float64)
    if clamped:
        clamp = normalise(torch.from_numpy(rng.normal(size=(count, 2, 4))))
    gravity = torch.tensor([0.0, 0.0, -1.0], dtype=torch.float64)
    properties = uniform(length=1.0, segments=nodes - 1, bend=torch.from_numpy(bend))
    rod = build(properties, gravity, (clamped, clamped))
    return Placements(rod, Conditions(ends, clamp), bend, apart)


def imbalance(p: Placements, solution: Solution) -> np.ndarray:
    """(F,) the larger of: the energy's slope in the frames, over the largest moment; the distance
    of the last node from its place, over the length. By autograd of `rod/energy.py`.

    The rope does not stretch: nodes follow from the frames, and the reaction pulls on the last.
    """
    rod, c = p.rod, p.conditions
    q = torch.from_numpy(solution.q)
    clamp = torch.nan_to_num(c.clamp, nan=0.5)
    reaction = torch.from_numpy(solution.reaction[:, :3])
    finite = rod._replace(
        flexibility=torch.ones_like(rod.flexibility)
    )  # costs nothing where strain is 0

    def nodes(frames: Tensor) -> Tensor:
        along = (rod.length[..., None] * director(frames)).cumsum(-2)
        return c.ends[:, :1] + torch.nn.functional.pad(along, (0, 0, 1, 0))

    def value(frames: Tensor) -> Tensor:
        frames = normalise(frames)
        x = nodes(frames)
        return (energy(finite, x, frames, clamp) - (reaction * x[:, -1]).sum(-1)).sum()

    free = q.clone().requires_grad_()
    slope = 0.5 * torch.autograd.grad(value(free), free)[0].norm(dim=-1).amax(-1)
    force = torch.from_numpy(solution.force).norm(dim=-1)
    moment = (rod.length * force).amax(-1).maximum(1e-4 * rod.stiffness.amax((-1, -2)))
    miss = (nodes(q)[:, -1] - c.ends[:, 1]).norm(dim=-1) / rod.length.sum(-1)
    return torch.maximum(slope / moment, miss).numpy()
