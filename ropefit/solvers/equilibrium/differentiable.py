"""Equilibria as differentiable functions in torch, by the adjoint of `implicit.py`."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch

from ropefit.errors import WrongUsage
from ropefit.rod.fields import ROD, names
from ropefit.rod.rod import Rod
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.implicit import pulled
from ropefit.solvers.equilibrium.kernels.records import Pull
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.equilibrium.turns import from_turn
from ropefit.solvers.rods import sum_of_ropes
from ropefit.solvers.xpbd.reference import State


def settle(
    rod: Rod,
    conditions: Conditions,
    start: States | None = None,
    member: np.ndarray | None = None,
) -> tuple[State, Solution]:
    """Solve, as a differentiable function: x (F, N+1, 3) [m] and q (F, N, 4), and how it went.

    Gradients reach every tensor of the rod and of the conditions, at the price of one more linear
    solve. Frames that did not converge are NaN.
    """
    solution = solve(rod, conditions, start, member)
    return settled(solution, rod, conditions), solution


def settled(solution: Solution, rod: Rod, conditions: Conditions) -> State:
    """Return a solution's states as a differentiable function of the tensors that its rod and its
    conditions were made of; it may have further loads and supports."""
    c = conditions
    inputs = [*rod, c.ends, c.clamp, c.direction, c.offset, c.compliance]
    far = solution.conditions.far_supports
    x, q = _Settle.apply(solution, far, *inputs)  # type: ignore[misc]
    if not solution.converged.all():
        bad = torch.from_numpy(~solution.converged)[:, None, None]
        x, q = torch.where(bad, torch.nan, x), torch.where(bad, torch.nan, q)
    return State(x, q)


class _Settle(torch.autograd.Function):
    """(rod, conditions) -> x, q of a solution already found; backward is one adjoint solve."""

    @staticmethod
    def forward(ctx, solution, far, *inputs):
        ctx.solution, ctx.far = solution, far
        ctx.shapes = [None if t is None else t.shape for t in inputs]
        ctx.save_for_backward(*inputs)
        return torch.from_numpy(solution.x.copy()), torch.from_numpy(solution.q.copy())

    @staticmethod
    def backward(ctx, *grads):
        with torch.no_grad():
            out = _Settle.pulled_back(ctx, *grads)
        if torch.is_grad_enabled():  # create_graph: a second derivative must be refused
            pulled = [item for item in out if item is not None]
            once = iter(_Once.apply(len(pulled), *pulled, *ctx.saved_tensors, *grads))  # type: ignore[misc]
            out = [None if item is None else next(once) for item in out]
        return None, None, *out

    @staticmethod
    def pulled_back(ctx, *grads):
        """Return the gradient of every input from those in x and q; None for what is not given."""
        problem, far = ctx.solution.problem, ctx.far
        g = pulled(ctx.solution, as_numpy(grads[0]), as_numpy(grads[1]))
        ropes = len(problem.rods.length)
        fields = [
            partial(sum_of_ropes, getattr(g, name), problem.of, ropes, shape)
            for name, shape in zip(names(ROD), ctx.shapes, strict=False)
        ]
        rest = [
            lambda: _of_ends(g, far),
            lambda: from_turn(problem.held.clamp, g.clamp, 2.0),
            *(partial(getattr(g, name).__getitem__, np.s_[:, far:]) for name in
              ("direction", "offset", "compliance")),
        ]  # fmt: skip
        return [
            torch.from_numpy(item().copy()).reshape(shape) if wanted and shape is not None else None
            for wanted, shape, item in zip(
                ctx.needs_input_grad[2:], ctx.shapes, [*fields, *rest], strict=True
            )
        ]


def _of_ends(g: Pull, far: int) -> np.ndarray:
    """Return the gradients in the ends' places (F, 2, 3)."""
    ends = np.zeros((len(g.anchor), 2, 3))
    ends[:, 0] = g.anchor
    if far:
        ends[:, 1] = g.offset[:, :3]
    return ends


class _Once(torch.autograd.Function):
    """The first `count` tensors as they are, tied to all others so that a derivative raises.

    torch's once_differentiable ties them to the incoming gradient alone: where that is a constant,
    a second derivative by a rigidity would silently be zero.
    """

    @staticmethod
    def forward(ctx, count, *tensors):
        return tuple(item.clone() for item in tensors[:count])

    @staticmethod
    def backward(ctx, *grads):
        raise WrongUsage(
            "a second derivative of a rope's shape is not computed; take finite differences of the "
            "gradient"
        )
