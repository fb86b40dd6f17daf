"""Many ropes at once as tensors on any device: balance of moments, its derivative, linear solves.

The same discrete rod, unknowns and letters as `equilibrium/kernels` (see there), with a dimension
of B ropes in front. Everything is float64 and stays on the device of `Ropes`; what `imbalance` and
`positions` compute can be differentiated in every field of `Ropes`.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import Tensor

from ropefit.rod.fields import ROD, names
from ropefit.rod.quaternion import conjugate_product
from ropefit.solvers.equilibrium.problem import Problem


class Ropes(NamedTuple):
    """B ropes of N segments and what holds each, S supports.

    The rod's fields as in `rod.fields.ROD`, gauge (B,) [N m], clamp (B, 2, 4), direction (B, S, 3),
    offset (B, S) [m], compliance (B, S) [m/N], active (B, S), reach (B, S, N): whether the support
    pulls on the segment, free (B,): nothing holds node 0.
    """

    length: Tensor
    flexibility: Tensor
    stiffness: Tensor
    rest: Tensor
    load: Tensor
    moment: Tensor
    gauge: Tensor
    clamp: Tensor
    direction: Tensor
    offset: Tensor
    compliance: Tensor
    active: Tensor
    reach: Tensor
    free: Tensor


class Bent(NamedTuple):
    """A state: frame R (B, N, 3, 3), force n (B, N, 3) in space, u and g (B, N, 3) in the segment's
    frame, p (B, N+1, 4) and moment m (B, N+1, 3) of the bend elements, x (B, N+1, 3) [m]."""

    frame: Tensor
    force: Tensor
    u: Tensor
    g: Tensor
    p: Tensor
    m: Tensor
    x: Tensor


class Hessian(NamedTuple):
    """Second derivative of L: blocks diagonal (B, N, 3, 3), off (B, N-1, 3, 3), border (B, N, 3, S)
    and corner (B, S+3, S+3) of the supports and of node 0."""

    diagonal: Tensor
    off: Tensor
    border: Tensor
    corner: Tensor


class Factor(NamedTuple):
    """inverse (B, N, 3, 3) of the pivots, off and border as in `Hessian`, solved (B, N, 3, S) the
    border's columns solved, schur (B, S+3, S+3), negative (B,) number of negative pivots."""

    inverse: Tensor
    off: Tensor
    border: Tensor
    solved: Tensor
    schur: Tensor
    negative: Tensor


def ropes_of(problem: Problem, device: torch.device) -> Ropes:
    """Return the ropes that the frames of a problem show, on a device."""
    rods, of, held = problem
    frames, segments = len(held.clamp), rods.length.shape[1]

    def put(array) -> Tensor:
        return torch.from_numpy(array).to(device)

    of, active = put(of), put(held.active)
    fields = rods._asdict() | {"rest": rods.rest[..., 1:]}
    beyond = put(held.node)[:, None] > torch.arange(segments, device=device)
    return Ropes._make([
        *(put(fields[name])[of] for name in (*names(ROD), "gauge")),
        put(held.clamp), put(held.direction), put(held.offset), put(held.compliance), active,
        (beyond & active[..., None]).to(torch.float64),
        torch.full((frames,), bool(held.free), device=device),
    ])  # fmt: skip


def skew(v: Tensor) -> Tensor:
    """Return (..., 3, 3) [v]x of v (..., 3)."""
    x, y, z = v.unbind(-1)
    o = torch.zeros_like(x)
    rows = [torch.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))]
    return torch.stack(rows, -2)


def turned(q: Tensor, turn: Tensor) -> Tensor:
    """Return (..., 4) q exp(turn / 2), normalised; turn (..., 3) [rad] about q's own axes."""
    half = 0.5 * torch.sqrt((turn * turn).sum(-1, keepdim=True) + 1e-40)
    w, v = torch.cos(half), 0.5 * torch.sinc(half / torch.pi) * turn
    a, b = q[..., :1], q[..., 1:]
    vector = a * v + w * b + torch.linalg.cross(b, v)
    out = torch.cat([a * w - (b * v).sum(-1, keepdim=True), vector], -1)
    return out / torch.linalg.norm(out, dim=-1, keepdim=True)


def bent(r: Ropes, q: Tensor, lam: Tensor, x0: Tensor) -> Bent:
    """Return the state of frames q (B, N, 4), forces lam (B, S) [N], node 0 at x0 (B, 3) [m]."""
    w, v = q[..., 0, None, None], q[..., 1:]
    identity = torch.eye(3, dtype=q.dtype, device=q.device)
    square = (v * v).sum(-1)[..., None, None]
    frame = (1 - 2 * square) * identity + 2 * v[..., :, None] * v[..., None, :] + 2 * w * skew(v)
    force = r.load[:, 1:].flip(1).cumsum(1).flip(1)
    force = force + (r.reach * lam[..., None]).mT @ r.direction
    u = (frame.mT @ force[..., None])[..., 0]
    g = r.length[..., None] * (r.flexibility * u + identity[2])
    x = torch.cat([x0[:, None], x0[:, None] + (frame @ g[..., None])[..., 0].cumsum(1)], 1)
    around = torch.cat([r.clamp[:, :1], q, r.clamp[:, 1:]], 1)
    p = conjugate_product(around[:, :-1], around[:, 1:])
    real = torch.sqrt((1 - (r.rest**2).sum(-1)).clamp_min(0.0))
    nearer = p[..., 0] * real + (p[..., 1:] * r.rest).sum(-1)
    p = torch.where(nearer < 0, -1.0, 1.0)[..., None] * p
    return Bent(frame, force, u, g, p, r.stiffness * (p[..., 1:] - r.rest), x)


def lagrangian(r: Ropes, lam: Tensor, x0: Tensor, s: Bent) -> Tensor:
    """Return (B,) [J] L, whose saddle point is the equilibrium."""
    stretch = (r.length * (s.u[..., 2] + 0.5 * (r.flexibility * s.u**2).sum(-1))).sum(-1)
    bend = 0.5 * (s.m * (s.p[..., 1:] - r.rest)).sum((-1, -2))
    gap = r.offset - (r.direction * x0[:, None]).sum(-1) - 0.5 * r.compliance * lam
    loose = torch.where(r.free, (x0[:, None] * r.load).sum((-1, -2)), 0.0)
    return bend - stretch + (r.active * lam * gap).sum(-1) - loose


def imbalance(r: Ropes, lam: Tensor, x0: Tensor, s: Bent) -> tuple[Tensor, Tensor]:
    """Return the derivative of L in the turns (B, N, 3) [N m], in λ [m] and x_0 [N] (B, S+3)."""
    h, v = 0.5 * s.p[..., :1], 0.5 * s.p[..., 1:]
    around, along = torch.linalg.cross(v, s.m), h * s.m
    moments = along[:, :-1] - along[:, 1:] - around[:, :-1] - around[:, 1:]
    moments = moments - torch.linalg.cross(s.g, s.u)
    given = _given_moments(r, s)
    moments = torch.cat([moments[:, :1] - given[:, :1], moments[:, 1:]], 1)
    moments = torch.cat([moments[:, :-1], moments[:, -1:] - given[:, 1:]], 1)
    place = x0[:, None] + r.reach @ (s.frame @ s.g[..., None])[..., 0]
    gap = r.active * (r.offset - (r.direction * place).sum(-1) - r.compliance * lam)
    total = r.load.sum(1) + (r.active * lam)[:, None].matmul(r.direction)[:, 0]
    return moments, torch.cat([gap, torch.where(r.free[:, None], -total, 0.0)], 1)


def _given_moments(r: Ropes, s: Bent) -> Tensor:
    """Return (B, 2, 3) [N m] the end moments in the frames of the first and last segment."""
    return torch.stack([
        (s.frame[:, end].mT @ r.moment[:, end, :, None])[..., 0] for end in (0, -1)
    ], 1)  # fmt: skip


def hessian(r: Ropes, s: Bent) -> tuple[Hessian, Tensor]:
    """Return the Hessian of L, and (B,) [N m] the largest moment that is balanced."""
    identity = torch.eye(3, dtype=s.u.dtype, device=s.u.device)
    segment_compliance = r.length[..., None] * r.flexibility
    gu = s.g[..., :, None] * s.u[..., None, :]
    cross_u = skew(s.u)
    diagonal = (s.g * s.u).sum(-1)[..., None, None] * identity - 0.5 * (gu + gu.mT)
    diagonal = diagonal - cross_u.mT @ (segment_compliance[..., None] * cross_u)
    h, v, stiffness = 0.5 * s.p[..., :1, None], skew(0.5 * s.p[..., 1:]), r.stiffness[..., None]
    after, before = v + h * identity, v - h * identity
    pm = s.p[..., 1:, None] * s.m[..., None, :]
    along = 0.25 * (s.m * s.p[..., 1:]).sum(-1)[..., None, None] * identity
    diagonal = diagonal + (after.mT @ (stiffness * after) - along)[:, :-1]
    diagonal = diagonal + (before.mT @ (stiffness * before) - along)[:, 1:]
    off = before.mT @ (stiffness * after) - along + 0.25 * (pm + pm.mT) + 0.5 * h * skew(s.m)
    given = _given_moments(r, s)
    # Moments that keep their direction in space have no potential: not symmetric.
    diagonal[:, 0] -= 0.5 * skew(given[:, 0])
    diagonal[:, -1] -= 0.5 * skew(given[:, 1])
    diagonal[:, 0, 2, 2] += r.gauge

    seen = torch.einsum("bnij,bsi->bsnj", s.frame, r.direction) * r.reach[..., None]
    strain = segment_compliance[:, None] * seen
    border = torch.linalg.cross(strain, s.u[:, None].expand_as(strain))
    border = -(border + torch.linalg.cross(s.g[:, None].expand_as(seen), seen))
    count = r.offset.shape[1]
    corner = s.u.new_zeros(len(s.u), count + 3, count + 3)
    corner[:, :count, :count] = -strain.flatten(2) @ seen.flatten(2).mT
    held = torch.where(r.active, r.compliance, 1.0)
    corner[:, :count, :count] -= torch.diag_embed(held)
    corner[:, :count, count:] = -r.direction * (r.active & r.free[:, None])[..., None]
    corner[:, count:, :count] = corner[:, :count, count:].mT
    corner[:, count:, count:] = -identity * (~r.free)[:, None, None]
    scale = [
        (s.g * s.g).sum(-1) * (s.u * s.u).sum(-1),
        (s.m * s.m).sum(-1),
        1e-8 * r.stiffness.amax(-1) ** 2,  # rounding in a frame costs this much
        (given * given).sum(-1),
    ]
    largest = torch.cat(scale, 1).amax(1).sqrt()
    return Hessian(diagonal, off[:, 1:-1], border.permute(0, 2, 3, 1), corner), largest


def factor(h: Hessian, shift: Tensor) -> Factor:
    """Return the block elimination of the Hessian, shift (B,) [N m] added to its diagonal."""
    add = shift[:, None, None] * torch.eye(3, dtype=shift.dtype, device=shift.device)
    negative = torch.zeros(len(shift), dtype=torch.int64, device=shift.device)
    inverses: list[Tensor] = []
    for i in range(h.diagonal.shape[1]):
        a = h.diagonal[:, i] + add
        if i:
            o = h.off[:, i - 1]
            a = a - o.mT @ inverses[-1] @ o
        first, second, third = a.unbind(1)
        cofactors = torch.stack([
            torch.linalg.cross(second, third), torch.linalg.cross(third, first),
            torch.linalg.cross(first, second),
        ], -1)  # fmt: skip
        determinant = (first * cofactors[..., 0]).sum(-1)
        minors = [torch.ones_like(determinant), a[:, 0, 0], cofactors[:, 2, 2], determinant]
        for smaller, larger in itertools.pairwise(minors):
            negative += (smaller < 0) != (larger < 0)
        inverses.append(cofactors / determinant[:, None, None])
    inverse = torch.stack(inverses, 1)
    solved = _eliminate(inverse, h.off, h.border)
    count = h.border.shape[-1]
    schur = h.corner.clone()
    schur[:, :count, :count] -= torch.einsum("bnas,bnat->bst", h.border, solved)
    return Factor(inverse, h.off, h.border, solved, schur, negative)


def _eliminate(inverse: Tensor, off: Tensor, right: Tensor) -> Tensor:
    """Return (B, N, 3, C) the solution of the block tridiagonal system for right (B, N, 3, C)."""
    z = [inverse[:, 0] @ right[:, 0]]
    for i in range(1, inverse.shape[1]):
        z.append(inverse[:, i] @ (right[:, i] - off[:, i - 1].mT @ z[-1]))
    for i in range(inverse.shape[1] - 2, -1, -1):
        z[i] = z[i] - inverse[:, i] @ (off[:, i] @ z[i + 1])
    return torch.stack(z, 1)


def saddle(f: Factor, moments: Tensor, gaps: Tensor) -> tuple[Tensor, Tensor]:
    """Return turns (B, N, 3) and (B, S+3) changes of λ and x_0 that the Hessian maps to the
    arguments; not finite where it is singular."""
    count = f.border.shape[-1]
    z = _eliminate(f.inverse, f.off, moments[..., None])
    right = gaps.clone()
    right[:, :count] -= torch.einsum("bnas,bna->bs", f.border, z[..., 0])
    y = torch.linalg.solve_ex(f.schur, right).result
    return z[..., 0] - (f.solved @ y[:, None, :count, None])[..., 0], y


def transposed(f: Factor) -> Factor:
    """Return the factor of the transposed Hessian."""
    inverse = f.inverse.mT
    return f._replace(
        inverse=inverse, solved=_eliminate(inverse, f.off, f.border), schur=f.schur.mT
    )


def descents(r: Ropes, f: Factor) -> Tensor:
    """Return (B,) how many directions that the supports allow descend; 1 where not finite."""
    finite = torch.isfinite(f.schur).all(-1).all(-1)
    expected = (~r.active | (r.compliance >= 0)).sum(-1) + torch.where(r.free, 0, 3)
    # Convex already, before the supports: no need to count the others.
    plain = (f.negative == 0) & ~r.free & (expected == r.active.shape[1] + 3)
    found = torch.where(finite, 0, 1)
    rest = torch.nonzero(finite & ~plain)[:, 0]
    if len(rest):
        signs = (torch.linalg.eigvalsh(f.schur[rest]) < 0).sum(-1)
        found[rest] = f.negative[rest] + signs - expected[rest]
    return found
