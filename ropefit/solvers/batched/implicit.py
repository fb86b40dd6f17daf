"""Derivatives of many equilibria at once, on any device, by the implicit function theorem."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.rod import DIMS, Rod
from ropefit.solvers.batched.ropes import (
    Ropes,
    bent,
    factor,
    hessian,
    imbalance,
    ropes_of,
    saddle,
    transposed,
    turned,
)
from ropefit.solvers.batched.solve import some
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.xpbd.reference import State


def settled_batched(
    solution: Solution, rod: Rod, conditions: Conditions, device: torch.device | str
) -> State:
    """Return a solution's states on `device`, as a differentiable function of the tensors that its
    rod and its conditions were made of.

    Without gradients (`torch.no_grad`) they are the solution's own.

    One more Newton step with the Hessian held is the implicit function theorem: the step is zero,
    its derivative in every input is that of the state.
    """
    device, frames = torch.device(device), len(solution.q)
    good = torch.from_numpy(np.flatnonzero(solution.converged)).to(device)
    if not torch.is_grad_enabled():
        plain = (torch.from_numpy(item).to(device)[good] for item in (solution.x, solution.q))
        return State(*(_spread(item, good, frames) for item in plain))
    problem = solution.problem
    ropes, x0 = _differentiable(ropes_of(problem, device), rod, conditions, problem.of)
    ropes = some(ropes, good)
    known = (solution.q, solution.reaction, solution.base)
    q, lam, base = (torch.from_numpy(a).to(device)[good] for a in known)
    x0 = base if x0 is None else x0[good]
    with torch.no_grad():
        f = factor(hessian(ropes, bent(ropes, q, lam, x0))[0], torch.zeros_like(ropes.gauge))
    step = _Saddle.apply(*imbalance(ropes, lam, x0, bent(ropes, q, lam, x0)), f)
    turn, change = step  # type: ignore[misc]
    q, lam = turned(q, -turn), lam - change[:, :-3]
    x0 = x0 - torch.where(ropes.free[:, None], change[:, -3:], 0.0)
    x = bent(ropes, q, lam, x0).x
    return State(_spread(x, good, frames), _spread(q, good, frames))


def _spread(item: Tensor, good: Tensor, frames: int) -> Tensor:
    """Return (F, ...) the rows `good` of a tensor whose other rows are NaN."""
    shape = (frames, *item.shape[1:])
    return torch.full(shape, torch.nan, dtype=item.dtype, device=item.device).index_put(
        (good,), item
    )


class _Saddle(torch.autograd.Function):
    """`saddle`, linear in its arguments, the factor being a constant."""

    @staticmethod
    def forward(ctx, moments, gaps, f):
        ctx.factor = f
        return saddle(f, moments, gaps)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):
        return *saddle(transposed(ctx.factor), *grads), None


def _differentiable(
    ropes: Ropes, rod: Rod, c: Conditions, of: np.ndarray
) -> tuple[Ropes, Tensor | None]:
    """Return the ropes as functions of the rod's and the conditions' own tensors.

    Also node 0 (F, 3) [m] where it is held, else None.
    """
    device, frames = ropes.length.device, len(of)
    index = torch.from_numpy(of).to(device)
    fields = {}
    for name, dim in zip(Rod._fields, DIMS, strict=True):
        value = getattr(rod, name).to(device, torch.float64)
        value = value if value.ndim == dim + 1 else value[None]
        fields[name] = value[index] if len(value) > 1 else value.expand(frames, *value.shape[1:])
    stiffness = fields["stiffness"]
    clamped = (stiffness != 0).any(-1, keepdim=True)  # no clamp, no derivative
    fields["stiffness"] = stiffness * clamped
    clamp = c.clamp.to(device, torch.float64)
    clamp = torch.where(torch.isnan(clamp), ropes.clamp, clamp)
    fields["clamp"] = clamp / torch.linalg.norm(clamp, dim=-1, keepdim=True)
    far = 3 if c.far_held else 0
    for name, given in (("direction", c.direction), ("offset", c.offset),
                        ("compliance", c.compliance)):  # fmt: skip
        first = getattr(ropes, name)[:, :far]
        if name == "offset" and far:
            first = c.ends[:, 1].to(device, torch.float64)
        more = [] if given is None else [given.to(device, torch.float64)]
        fields[name] = torch.cat([first, *more], 1)
    return ropes._replace(**fields), None if c.free else c.ends[:, 0].to(device, torch.float64)
