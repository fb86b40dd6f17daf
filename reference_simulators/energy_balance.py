"""Check states of ropes by automatic differentiation of the energy (`rod_energy.py`).

No code is shared with the solvers: they use neither this energy nor automatic differentiation.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from reference_simulators.rod_energy import energy, own, tensors
from ropefit.rod.moving import DRAG_SPEEDS, Moving
from ropefit.rod.quaternion import conjugate_product, director, normalise
from ropefit.rod.rod import Rod
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution


def equilibrium_residual(rod: Rod, c: Conditions, solution: Solution) -> np.ndarray:
    """Return the residual (F,) of inextensible ropes held at both ends.

    The larger of: the energy's slope in the frames, over the largest moment; the distance of the
    last node from its place, over the length. Nodes follow from the frames, and the reaction pulls
    on the last.
    """
    rod, ends, q = tensors(rod), tensors(c.ends), torch.from_numpy(solution.q)
    clamp = torch.nan_to_num(tensors(c.clamp), nan=0.5)
    reaction = torch.from_numpy(solution.reaction[:, :3])
    finite = rod._replace(
        flexibility=torch.ones_like(rod.flexibility)
    )  # costs nothing where strain is 0

    def nodes(frames: Tensor) -> Tensor:
        along = (rod.length[..., None] * director(frames)).cumsum(-2)
        return ends[:, :1] + torch.nn.functional.pad(along, (0, 0, 1, 0))

    def value(frames: Tensor) -> Tensor:
        frames = normalise(frames)
        x = nodes(frames)
        return (energy(finite, x, frames, clamp) - (reaction * x[:, -1]).sum(-1)).sum()

    free = q.clone().requires_grad_()
    slope = 0.5 * torch.autograd.grad(value(free), free)[0].norm(dim=-1).amax(-1)
    force = torch.from_numpy(solution.force).norm(dim=-1)
    moment = (rod.length * force).amax(-1).maximum(1e-4 * rod.stiffness.amax((-1, -2)))
    miss = (nodes(q)[:, -1] - ends[:, 1]).norm(dim=-1) / rod.length.sum(-1)
    return torch.maximum(slope / moment, miss).numpy()


def rates(time: Tensor, y: Tensor, first: Tensor | None = None) -> Tensor:
    """Return rates (C, T, ...) of values y (C, T, ...) at times (C, T), by BDF2.

    The slope at the end of the parabola through three values in a row; the first step's is of a
    line, that at time 0 is `first`, or 0.
    """
    wide = (..., *[None] * (y.ndim - 2))
    h = time.diff(dim=1)
    slope = y.diff(dim=1) / h[wide]
    bent = (slope[:, 1:] - slope[:, :-1]) / (h[:, 1:] + h[:, :-1])[wide]
    start = torch.zeros_like(y[:, 0]) if first is None else first
    return torch.cat([start[:, None], slope[:, :1], slope[:, 1:] + bent * h[:, 1:][wide]], dim=1)


def bends(rope: Moving, q: Tensor, clamp: Tensor) -> Tensor:
    """Return vector parts (C, T, N+1, 3) of the Darboux quaternions, of the sign nearer to rest."""
    every = torch.cat([clamp[..., :1, :], q, clamp[..., 1:, :]], dim=-2)
    p = conjugate_product(every[..., :-1, :], every[..., 1:, :])
    rest = rope.rod.rest[:, None]
    real = torch.sqrt(1 - (rest**2).sum(-1))
    nearer = p[..., 0] * real + (p[..., 1:] * rest).sum(-1)
    return torch.where(nearer < 0, -1.0, 1.0)[..., None] * p[..., 1:]


def drag_factor(drag: Tensor, speed: Tensor) -> Tensor:
    """Return what the air's resistance is multiplied by at speeds (C, ...) [m/s]."""
    octaves = np.log2(np.maximum(speed.detach().numpy(), 1e-9))
    knots = np.log2(DRAG_SPEEDS)
    laws = drag.detach().expand(len(speed), -1).numpy()
    values = [np.interp(o, knots, law) for o, law in zip(octaves, laws, strict=True)]
    return torch.from_numpy(np.exp(np.stack(values)))


def step_residual(rope: Moving, drive: Drive, start: Start, found: Trajectory) -> np.ndarray:
    """Return the residual (C, T) of every step of the implicit dynamics.

    The largest of: the nodes' forces, over the largest force; the segments' moments, over that
    force times a segment; lengths and places, over the length. 0 at time 0, NaN without a state.
    """
    rope, drive, start = tensors(rope), tensors(drive), tensors(start)
    rod = type(rope.rod)(*(t[:, None] for t in rope.rod))
    rigid = bool((rod.flexibility == 0).all())
    if rigid:  # costs nothing where the strain is 0
        rod = rod._replace(flexibility=torch.ones_like(rod.flexibility))
    x = torch.from_numpy(found.x).clone().requires_grad_()
    q = torch.from_numpy(found.q).clone().requires_grad_()
    force = torch.from_numpy(found.force)
    clamp = torch.nan_to_num(drive.clamp, nan=0.5)
    frames = normalise(q)
    edge = x[:, :, 1:] - x[:, :, :-1]
    speed = rates(drive.time, x.detach(), start.v)
    push = rates(drive.time, speed) * rope.mass[:, None, :, None]
    before = torch.cat([speed[:, :1], speed[:, :-1]], dim=1)
    further = torch.cat([before[:, :1], before[:, :-1]], dim=1)
    share = torch.ones_like(drive.time)
    share[:, 2:] = drive.time.diff()[:, 1:] / drive.time.diff()[:, :-1]
    ahead = (before + share[..., None, None] * (before - further)).norm(dim=-1)
    push = push + (rope.air[:, None] * drag_factor(rope.drag, ahead))[..., None] * speed
    push = push + rope.spring[:, None, :, None] * x.detach()
    p = bends(rope, frames, clamp)
    loss = rates(drive.time, p.detach()) * rope.bend_viscosity[:, None]
    value = energy(rod, x, frames, clamp) + (loss * p).sum((-1, -2)) + (push * x).sum((-1, -2))
    if rigid:
        value = value + (force * (edge - rod.length[..., None] * director(frames))).sum((-1, -2))
    else:
        strain = own(frames, edge / rod.length[..., None])
        slow = rates(drive.time, strain.detach()) * rope.strain_viscosity[:, None]
        value = value + (rod.length[..., None] * slow * strain).sum((-1, -2))
    by_x, by_q = torch.autograd.grad(value.nansum(), (x, q))
    largest = force.norm(dim=-1).amax(-1).maximum(rope.rod.load.norm(dim=-1).sum(-1)[:, None])
    ends = torch.stack([x[:, :, 0], x[:, :, -1]], dim=2).detach() - drive.ends
    by_x = by_x.clone()
    for end, node in ((0, 0), (1, -1)):
        if not bool(torch.isnan(drive.ends[:, :, end]).any()):
            by_x[:, :, node] = 0.0
    left = by_x.norm(dim=-1).amax(-1) / largest
    lever = (rod.length.amax(-1) * largest).maximum(
        1e-4 * rope.rod.stiffness.amax((-1, -2))[:, None]
    )
    turning = 0.5 * by_q.norm(dim=-1).amax(-1) / lever
    miss = torch.nan_to_num(ends).norm(dim=-1).amax(-1)
    if rigid:
        gap = (edge - rod.length[..., None] * director(frames)).detach().norm(dim=-1).amax(-1)
        miss = miss.maximum(gap)
    out = torch.stack([left, turning, miss / rod.length.sum(-1)]).amax(0)
    out[torch.isnan(_state(found))] = torch.nan
    out[:, 0] = 0.0
    return out.detach().numpy()


def _state(found: Trajectory) -> Tensor:
    """Return (C, T): a number where there is a state, NaN where there is none."""
    return torch.from_numpy(found.x.sum((-1, -2)) + found.q.sum((-1, -2)))


def energy_gain(
    rope: Moving, drive: Drive, start: Start, found: Trajectory, rest: int
) -> np.ndarray:
    """Return the largest gain (C,) of mechanical energy after step `rest`, when the ends are still.

    Dimensionless: over the weight times the length plus the largest kinetic energy.
    """
    rope, drive, start = tensors(rope), tensors(drive), tensors(start)
    rod = type(rope.rod)(*(t[:, None] for t in rope.rod))
    if bool((rod.flexibility == 0).all()):
        rod = rod._replace(flexibility=torch.full_like(rod.flexibility, 1e9))
    x, q = torch.from_numpy(found.x), torch.from_numpy(found.q)
    speed = rates(drive.time, x, start.v)
    kinetic = 0.5 * (rope.mass[:, None] * (speed**2).sum(-1)).sum(-1)
    total = kinetic + energy(rod, x, q, torch.nan_to_num(drive.clamp, nan=0.5))
    still = total[:, rest + 3 :]
    weight = rope.rod.load.norm(dim=-1).sum(-1) * rope.rod.length.sum(-1)
    most = torch.nan_to_num(still - total[:, rest + 2 : rest + 3], nan=-math.inf).amax(1)
    return (most / (weight + torch.nan_to_num(kinetic).amax(1))).numpy()
