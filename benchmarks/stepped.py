"""Random ropes in motion, and an answer to whether a step is one of the implicit dynamics that
shares no code with the solver."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from benchmarks.motions import paths
from ropefit.rod.energy import energy, own
from ropefit.rod.moving import Damping, Moving, moving
from ropefit.rod.quaternion import conjugate_product, director, normalise
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle

DOWN = torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64)
DENSITY = 0.06  # kg/m
STOP = 0.6  # share of the time after which the ends stand still


class Motions(NamedTuple):
    """C ropes that move; rest: the step from which their ends stand still."""

    rope: Moving
    drive: Drive
    start: Start
    rest: int


def motions(count: int, ends: str, stretchy: bool, nodes: int, steps: int, seed: int) -> Motions:
    """Ropes of 1 m and 60 g, led from an equilibrium and then held still.

    ends: pinned, clamped, or hung (clamped at one end, the other let go). Steps of 1 to 50 ms, each
    up to 30 % longer or shorter; paths of up to half a radian and a quarter of a metre at up to
    3 Hz; EI 1e-6 to 1e-1 of the weight, bent at rest in a half of those that are clamped; damping
    of bends 1e-4 to 1e-1 s and air up to 1 N s/m², none in a quarter each. Stretchy: EA 10 to
    1e5 N.
    """
    rng = np.random.default_rng(seed)
    clamped = {"pinned": (False, False), "clamped": (True, True), "hung": (True, False)}[ends]

    def per_rope(low: float, high: float) -> np.ndarray:
        return 10 ** rng.uniform(low, high, count)

    stride = per_rope(-3, math.log10(0.05))[:, None] * rng.uniform(0.7, 1.3, (count, steps))
    time = np.cumsum(stride, axis=1) - stride[:, :1]
    rest = round(STOP * steps)
    share = np.minimum(time / time[:, rest : rest + 1], 1.0)
    warped = time[:, rest : rest + 1] * share**2 * (3 - 2 * share)
    way = paths(rng, count, warped, per_rope(-2, math.log10(0.5)), 3.0)
    held = way.ends.clone()
    clamp = way.clamp.clone()
    for end in range(2):
        if not clamped[end]:
            clamp[:, :, end] = torch.nan

    tensor = torch.from_numpy
    bend = tensor(per_rope(-6, -1) * DENSITY * 9.81)
    curvature = tensor(rng.normal(0, 1, (count, 3)) * (rng.uniform(size=(count, 1)) < 0.5))
    if ends == "pinned":
        curvature = torch.zeros(count, 3, dtype=torch.float64)
    axial = tensor(per_rope(1, 5)) if stretchy else math.inf
    p = uniform(
        length=1.0, segments=nodes - 1, bend=bend, axial=axial, density=DENSITY, curvature=curvature
    )
    some = rng.uniform(size=(2, count)) > 0.25
    relaxation = tensor(per_rope(-4, -1) * some[0])[:, None]
    air = tensor(rng.uniform(0, 1, count) * some[1])[:, None].expand(p.length.shape)
    viscous = 1e-3 * p.axial if stretchy else torch.zeros_like(p.length)
    damping = Damping(relaxation * p.bend, relaxation * p.twist, viscous, air)
    rod = build(p, DOWN, clamped)
    at = settle(rod, Conditions(held[:, 0], clamp[:, 0]))
    if ends == "hung":
        held[:, :, 1] = torch.nan
    start = Start(tensor(at.x), tensor(at.q), torch.zeros(count, nodes, 3, dtype=torch.float64))
    few = torch.from_numpy(np.flatnonzero(at.converged))
    rod, *others = moving(p, rod, damping)
    rope = Moving(Rod(*(t[few] for t in rod)), *(t[few] for t in others))
    return Motions(
        rope, Drive(tensor(time), held, clamp).clips(few), Start(*(s[few] for s in start)), rest
    )


def rates(time: Tensor, y: Tensor, first: Tensor | None = None) -> Tensor:
    """(C, T, ...) slopes at the ends of the parabolas through three values in a row: of values y
    (C, T, ...) at times (C, T). The first step's is of a line, that at time 0 is `first`, or 0."""
    wide = (..., *[None] * (y.ndim - 2))
    h = time.diff(dim=1)
    slope = y.diff(dim=1) / h[wide]
    bent = (slope[:, 1:] - slope[:, :-1]) / (h[:, 1:] + h[:, :-1])[wide]
    start = torch.zeros_like(y[:, 0]) if first is None else first
    return torch.cat([start[:, None], slope[:, :1], slope[:, 1:] + bent * h[:, 1:][wide]], dim=1)


def bends(rope: Moving, q: Tensor, clamp: Tensor) -> Tensor:
    """(C, T, N+1, 3) vector parts of the Darboux quaternions, of the sign nearer to rest."""
    every = torch.cat([clamp[..., :1, :], q, clamp[..., 1:, :]], dim=-2)
    p = conjugate_product(every[..., :-1, :], every[..., 1:, :])
    rest = rope.rod.rest[:, None]
    real = torch.sqrt(1 - (rest**2).sum(-1))
    nearer = p[..., 0] * real + (p[..., 1:] * rest).sum(-1)
    return torch.where(nearer < 0, -1.0, 1.0)[..., None] * p[..., 1:]


def imbalance(m: Motions, found: Trajectory) -> np.ndarray:
    """(C, T) of every step: the largest of what is left of the nodes' forces, over the largest
    force; of the segments' moments, over that force times a segment; of lengths and places, over
    the length. 0 at time 0, NaN where there is no state. By autograd of `rod/energy.py`."""
    rope, drive = m.rope, m.drive
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
    speed = rates(drive.time, x.detach(), m.start.v)
    push = rates(drive.time, speed) * rope.mass[:, None, :, None]
    push = push + rope.air[:, None, :, None] * speed
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
    out[torch.isnan(found_state(found))] = torch.nan
    out[:, 0] = 0.0
    return out.detach().numpy()


def found_state(found: Trajectory) -> Tensor:
    """(C, T) a number where there is a state, NaN where there is none."""
    return torch.from_numpy(found.x.sum((-1, -2)) + found.q.sum((-1, -2)))


def gain(m: Motions, found: Trajectory) -> np.ndarray:
    """(C,) [J] the most mechanical energy that a rope has after its ends have come to rest beyond
    what it had then, over its weight times its length and its largest kinetic energy."""
    rope = m.rope
    rod = type(rope.rod)(*(t[:, None] for t in rope.rod))
    if bool((rod.flexibility == 0).all()):
        rod = rod._replace(flexibility=torch.full_like(rod.flexibility, 1e9))
    x, q = torch.from_numpy(found.x), torch.from_numpy(found.q)
    speed = rates(m.drive.time, x, m.start.v)
    kinetic = 0.5 * (rope.mass[:, None] * (speed**2).sum(-1)).sum(-1)
    total = kinetic + energy(rod, x, q, torch.nan_to_num(m.drive.clamp, nan=0.5))
    still = total[:, m.rest + 3 :]
    weight = rope.rod.load.norm(dim=-1).sum(-1) * rope.rod.length.sum(-1)
    most = torch.nan_to_num(still - total[:, m.rest + 2 : m.rest + 3], nan=-math.inf).amax(1)
    return (most / (weight + torch.nan_to_num(kinetic).amax(1))).numpy()
