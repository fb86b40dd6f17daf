"""Clips as differentiable functions in torch, by the exact discrete adjoint, which keeps the states
only."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.fields import MOVING_ROD, names, zeros
from ropefit.rod.moving import Moving
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.dynamics.derivatives import OF_ROD
from ropefit.solvers.dynamics.kernels.entries import adjoint_clips
from ropefit.solvers.dynamics.kernels.records import CLIP, Change
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium.turns import from_turn, to_turn
from ropefit.solvers.rods import sum_of_ropes


def simulate(
    rope: Moving,
    drive: Drive,
    start: Start,
    member: np.ndarray | None = None,
) -> tuple[Tensor, Tensor, Trajectory]:
    """Run `solve` as a differentiable function: x (C, T, N+1, 3) [m], q (C, T, N, 4), how it went.

    Gradients reach every tensor of the rope, the drive (not its times) and the start. On an
    accelerator: `solvers.batched.simulate`. Raises ArithmeticError when a step fails.
    """
    trajectory = solve(rope, drive, start, member)
    if not trajectory.converged.all():
        raise ArithmeticError(trajectory.why())
    of_rope = rope.rod._asdict() | rope._asdict()
    inputs = [*(of_rope[name] for name in names(MOVING_ROD)), drive.ends, drive.clamp]
    x, q = _Simulate.apply(trajectory, *inputs, start.x, start.v, start.q)  # type: ignore[misc]
    return x, q, trajectory


class _Simulate(torch.autograd.Function):
    """The states of a trajectory already found; backward is the discrete adjoint."""

    @staticmethod
    def forward(ctx, trajectory, *inputs):
        ctx.trajectory = trajectory
        ctx.shapes = [tuple(t.shape) for t in inputs]
        return torch.from_numpy(trajectory.x.copy()), torch.from_numpy(trajectory.q.copy())

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):
        s: Trajectory = ctx.trajectory
        problem = s.problem
        clips, steps, n = s.q.shape[:3]
        out = Change(**zeros((*MOVING_ROD, *CLIP), (clips,), n, T=steps))
        force = np.nan_to_num(s.force)
        turns = to_turn(s.q, as_numpy(grads[1]), 0.5)
        arguments = (*problem, s.v0, s.x, s.q, force, as_numpy(grads[0]).copy(), turns, out)
        adjoint_clips(*arguments)
        ropes = len(problem.rods.length)
        gradients = []
        for name, shape in zip(Change._fields, ctx.shapes, strict=True):
            value = getattr(out, name)
            if name in OF_ROD:
                value = sum_of_ropes(value, problem.of, ropes, shape)
            elif name == "clamp":
                value = from_turn(problem.drives.clamp, value, 2.0)
            elif name == "q0":
                value = from_turn(s.q[:, 0], value, 2.0)
            gradients.append(torch.from_numpy(np.ascontiguousarray(value)).reshape(shape))
        return None, *gradients
