"""Many ropes in motion as tensors on any device: one time step's residual, matrix and solution.

The same discrete rod, unknowns (turns of the segments, forces in them) and letters as
`dynamics/kernels` (see there), with a dimension of B clips in front. Everything is float64;
`advanced` can be differentiated in what it is given.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ropefit.rod.fields import OCTAVES
from ropefit.rod.quaternion import conjugate_product
from ropefit.solvers.batched.ropes import skew, turned

EDGE = (0.0, 0.0, 1.0)  # of an unstrained segment in its own frame, over its length


class Clips(NamedTuple):
    """B ropes of N segments in motion: the fields of `rod.fields.MOVING_ROD`.

    gauge (B,) [N m] as in `dynamics/kernels/records.py`.
    """

    length: Tensor
    flexibility: Tensor
    stiffness: Tensor
    rest: Tensor
    load: Tensor
    strain_viscosity: Tensor
    bend_viscosity: Tensor
    mass: Tensor
    spring: Tensor
    air: Tensor
    drag: Tensor
    bodies: Tensor
    gauge: Tensor


class Drives(NamedTuple):
    """How the ends are at one time: ends (B, 2, 3) [m], clamp (B, 2, 4); held: which ends are."""

    ends: Tensor
    clamp: Tensor
    held: tuple[bool, bool]


class Past(NamedTuple):
    """States whose rates count: nodes x (B, N+1, 3) [m], their speeds v, Darboux vectors p
    (B, N+1, 3), strains (B, N, 3)."""

    x: Tensor
    v: Tensor
    p: Tensor
    strain: Tensor


class Known(NamedTuple):
    """What stays the same in the iterations of a step.

    c0 (B,) [1/s]; past: what the rates take from the two states before; y (B, N+1, 3) [m] and
    give (B, N+1) [m/N]: the nodes without forces, and how far a force moves them.
    """

    c0: Tensor
    past: Past
    y: Tensor
    give: Tensor


class Bends(NamedTuple):
    """Of every node: Darboux quaternion p (B, N+1, 4), moment m and stiffness (B, N+1, 3)."""

    p: Tensor
    m: Tensor
    firm: Tensor


class Segments(NamedTuple):
    """Frames R (B, N, 3, 3), force u and edge g (B, N, 3) in them, l dΓ/du (B, N, 3) [m/N]."""

    frame: Tensor
    u: Tensor
    g: Tensor
    yields: Tensor


class Factor(NamedTuple):
    """inverse (B, N, 6, 6) of the block pivots; off (B, N-1, 6, 6)."""

    inverse: Tensor
    off: Tensor


def step_ratio(time: Tensor, t: int) -> Tensor:
    """Return (B,) the length of the step to time t over that of the one before, t > 1."""
    return (time[:, t] - time[:, t - 1]) / (time[:, t - 1] - time[:, t - 2])


def rates(time: Tensor, t: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return c0, c1, c2 (B,) [1/s] of BDF2 at time t; time (B, T) [s]. Euler's at the first."""
    h = time[:, t] - time[:, t - 1]
    if t == 1:
        return 1 / h, -1 / h, torch.zeros_like(h)
    w = step_ratio(time, t)
    return (1 + 2 * w) / ((1 + w) * h), -(1 + w) / h, w * w / ((1 + w) * h)


def combined(c1: Tensor, c2: Tensor, one: Past, two: Past) -> Past:
    """Return c1 `one` + c2 `two`, field by field."""
    a, b = c1[:, None, None], c2[:, None, None]
    return Past(*(a * f + b * g for f, g in zip(one, two, strict=True)))


def resistance(r: Clips, time: Tensor, t: int, one: Tensor, two: Tensor) -> Tensor:
    """Return (B, N+1) [N s/m] the air's resistance to the nodes in the step to time t.

    one, two (B, N+1, 3) [m/s]: speeds one and two steps before. See `dynamics/kernels/drag.py`.
    """
    ahead = one
    if t > 1:
        ahead = one + step_ratio(time, t)[:, None, None] * (one - two)
    square = torch.nan_to_num((ahead**2).sum(-1))  # NaN: a clip that failed
    lowest, highest = (4.0**octave for octave in OCTAVES)
    octave = 0.5 * torch.log2(square.clamp(lowest, highest)) - OCTAVES[0]
    knot = octave.detach().floor().clamp(max=r.drag.shape[-1] - 2).long()
    below, above = r.drag.gather(1, knot), r.drag.gather(1, knot + 1)
    return r.air * torch.exp(below + (octave - knot) * (above - below))


def known(r: Clips, d: Drives, c0: Tensor, past: Past, air: Tensor) -> Known:
    """Return what one step starts from; past: the combined states before; air: `resistance`."""
    c = c0[:, None]
    drag = r.mass * c + air
    give = 1 / (drag * c + r.spring)
    y = give[..., None] * (r.load - drag[..., None] * past.x - r.mass[..., None] * past.v)
    for end, node in ((0, 0), (1, r.length.shape[1])):
        if d.held[end]:
            at = torch.zeros_like(give)
            at[:, node] = 1.0
            give = give * (1 - at)
            y = torch.where(at[..., None] > 0, d.ends[:, end, None], y)
    return Known(c0, past, y, give)


def frames(q: Tensor) -> Tensor:
    """Return R (..., 3, 3) of quaternions (..., 4)."""
    w, v = q[..., 0, None, None], q[..., 1:]
    square = (v * v).sum(-1)[..., None, None]
    identity = torch.eye(3, dtype=q.dtype, device=q.device)
    return (1 - 2 * square) * identity + 2 * v[..., :, None] * v[..., None, :] + 2 * w * skew(v)


def darboux(r: Clips, clamp: Tensor, q: Tensor) -> Tensor:
    """Return (B, N+1, 4) at every node, of the sign that lies nearer to the rest rotation."""
    around = torch.cat([clamp[:, :1], q, clamp[:, 1:]], 1)
    p = conjugate_product(around[:, :-1], around[:, 1:])
    real = torch.sqrt((1 - (r.rest**2).sum(-1)).clamp_min(0.0))
    nearer = p[..., 0] * real + (p[..., 1:] * r.rest).sum(-1)
    return torch.where(nearer < 0, -1.0, 1.0)[..., None] * p


def strains(r: Clips, x: Tensor, q: Tensor) -> Tensor:
    """Return Γ (B, N, 3) of nodes x (B, N+1, 3) and frames q (B, N, 4)."""
    edges = (x[:, 1:] - x[:, :-1]) / r.length[..., None]
    return (frames(q).mT @ edges[..., None])[..., 0] - x.new_tensor(EDGE)


def nodes(k: Known, force: Tensor) -> Tensor:
    """Return x (B, N+1, 3) [m] by the forces (B, N, 3) [N] in the segments."""
    none = torch.zeros_like(force[:, :1])
    pull = torch.cat([force, none], 1) - torch.cat([none, force], 1)
    return k.y + k.give[..., None] * pull


def bends(r: Clips, k: Known, clamp: Tensor, q: Tensor) -> Bends:
    """Return the bend elements of frames q (B, N, 4)."""
    p, c = darboux(r, clamp, q), k.c0[:, None, None]
    m = r.stiffness * (p[..., 1:] - r.rest) + r.bend_viscosity * (c * p[..., 1:] + k.past.p)
    return Bends(p, m, r.stiffness + c * r.bend_viscosity)


def segments(r: Clips, k: Known, q: Tensor, force: Tensor) -> Segments:
    """Return the segments of frames q (B, N, 4) that bear forces (B, N, 3)."""
    frame, c, length = frames(q), k.c0[:, None, None], r.length[..., None]
    u = (frame.mT @ force[..., None])[..., 0]
    yields = length * r.flexibility / (1 + r.flexibility * r.strain_viscosity * c)
    g = yields * (u - r.strain_viscosity * k.past.strain) + length * u.new_tensor(EDGE)
    return Segments(frame, u, g, yields)


def residual(k: Known, s: Segments, b: Bends, force: Tensor) -> Tensor:
    """Return (B, N, 6): moments [N m] about the segments' own axes, and gaps [m] of the edges."""
    half = 0.5 * b.p[..., :1] * b.m
    around = torch.linalg.cross(0.5 * b.p[..., 1:], b.m)
    moments = half[:, :-1] - half[:, 1:] - around[:, :-1] - around[:, 1:]
    moments = moments - torch.linalg.cross(s.g, s.u)
    x = nodes(k, force)
    gaps = x[:, 1:] - x[:, :-1] - (s.frame @ s.g[..., None])[..., 0]
    return torch.cat([moments, gaps], -1)


def matrix(r: Clips, k: Known, s: Segments, b: Bends) -> tuple[Tensor, Tensor]:
    """Return the derivative of `residual`: blocks (B, N, 6, 6), and beside them (B, N-1, 6, 6)."""
    identity = torch.eye(3, dtype=s.u.dtype, device=s.u.device)
    gu, cross = s.g[..., :, None] * s.u[..., None, :], skew(s.u)
    own = (s.g * s.u).sum(-1)[..., None, None] * identity - 0.5 * (gu + gu.mT)
    own = own - cross.mT @ (s.yields[..., None] * cross)
    h, v, firm = 0.5 * b.p[..., :1, None], skew(0.5 * b.p[..., 1:]), b.firm[..., None]
    after, before = v + h * identity, v - h * identity
    pm = b.p[..., 1:, None] * b.m[..., None, :]
    along = 0.25 * (b.m * b.p[..., 1:]).sum(-1)[..., None, None] * identity
    own = own + (after.mT @ (firm * after) - along)[:, :-1]
    own = own + (before.mT @ (firm * before) - along)[:, 1:]
    own[:, 0, 2, 2] += r.gauge
    beside = before.mT @ (firm * after) - along + 0.25 * (pm + pm.mT) + 0.5 * h * skew(b.m)
    mixed = (cross * s.yields[..., None, :] - skew(s.g)) @ s.frame.mT
    give = k.give[..., None, None] * identity
    loose = -(s.frame * s.yields[..., None, :]) @ s.frame.mT - give[:, :-1] - give[:, 1:]
    pivot = torch.cat([torch.cat([own, mixed], -1), torch.cat([mixed.mT, loose], -1)], -2)
    none = torch.zeros_like(beside[:, 1:-1])
    inner = torch.cat([beside[:, 1:-1], none], -1), torch.cat([none, give[:, 1:-1]], -1)
    return pivot, torch.cat(inner, -2)


def factor(pivot: Tensor, off: Tensor) -> Factor:
    """Return the block elimination of `matrix`; not finite where it is singular."""
    inverses = [torch.linalg.inv_ex(pivot[:, 0]).inverse]
    for i in range(1, pivot.shape[1]):
        o = off[:, i - 1]
        inverses.append(torch.linalg.inv_ex(pivot[:, i] - o.mT @ inverses[-1] @ o).inverse)
    return Factor(torch.stack(inverses, 1), off)


def eliminated(f: Factor, right: Tensor) -> Tensor:
    """Return (B, N, 6) what the matrix maps to right (B, N, 6)."""
    z = [(f.inverse[:, 0] @ right[:, 0, :, None])]
    for i in range(1, right.shape[1]):
        z.append(f.inverse[:, i] @ (right[:, i, :, None] - f.off[:, i - 1].mT @ z[-1]))
    for i in range(right.shape[1] - 2, -1, -1):
        z[i] = z[i] - f.inverse[:, i] @ (f.off[:, i] @ z[i + 1])
    return torch.cat(z, -1).mT


def advanced(
    r: Clips, d: Drives, k: Known, q: Tensor, force: Tensor, f: Factor
) -> tuple[Past, Tensor]:
    """Return the state that a step came to, and its frames, as functions of r, d and k.

    One more Newton step with the matrix held is the implicit function theorem: the step is zero,
    its derivative in every input is that of the state. q, force: what the step came to.
    """
    b, s = bends(r, k, d.clamp, q), segments(r, k, q, force)
    step = _Eliminated.apply(residual(k, s, b, force), f)
    q, force = turned(q, -step[..., :3]), force - step[..., 3:]  # type: ignore[index]
    x = nodes(k, force)
    speed = k.c0[:, None, None] * x + k.past.x
    return Past(x, speed, darboux(r, d.clamp, q)[..., 1:], strains(r, x, q)), q


class _Eliminated(torch.autograd.Function):
    """`eliminated`, linear in its argument, the factor being a constant."""

    @staticmethod
    def forward(ctx, right, f):
        ctx.factor = f
        return eliminated(f, right)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):
        f = ctx.factor
        return eliminated(f._replace(inverse=f.inverse.mT), grad), None
