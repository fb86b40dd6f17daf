"""Derivatives of simulated clips.

`simulate` is a differentiable function in torch, by the exact discrete adjoint, which keeps the
states only; `tangent` gives forward derivatives for least squares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.fields import MOVING_ROD, names, shapes, zeros
from ropefit.rod.moving import Moving
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.dynamics.kernels.entries import adjoint_clips, tangent_clips
from ropefit.solvers.dynamics.kernels.records import CLIP, Change
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium.turns import from_turn, to_turn

OF_ROD = frozenset(names(MOVING_ROD))


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
                total = np.zeros((ropes, *value.shape[1:]))
                np.add.at(total, problem.of, value)
                value = total if len(shape) == value.ndim else total.sum(axis=0)
            elif name == "clamp":
                value = from_turn(problem.drives.clamp, value, 2.0)
            elif name == "q0":
                value = from_turn(s.q[:, 0], value, 2.0)
            gradients.append(torch.from_numpy(np.ascontiguousarray(value)).reshape(shape))
        return None, *gradients


class Directions(NamedTuple):
    """P directions of change for `tangent`; what is None does not change.

    Of R ropes, or one: the fields of `rod.fields.MOVING_ROD`, with a dimension of P between that of
    the ropes and their own: length (R, P, N). Of C clips, likewise: ends (C, P, T, 2, 3), clamp
    (C, P, T, 2, 3) as turns [rad] about the clamp's own axes, x0 and v0 (C, P, N+1, 3), q0
    (C, P, N, 3) as turns.
    """

    length: np.ndarray | None = None
    flexibility: np.ndarray | None = None
    strain_viscosity: np.ndarray | None = None
    stiffness: np.ndarray | None = None
    bend_viscosity: np.ndarray | None = None
    rest: np.ndarray | None = None
    load: np.ndarray | None = None
    mass: np.ndarray | None = None
    spring: np.ndarray | None = None
    air: np.ndarray | None = None
    drag: np.ndarray | None = None
    bodies: np.ndarray | None = None
    ends: np.ndarray | None = None
    clamp: np.ndarray | None = None
    x0: np.ndarray | None = None
    v0: np.ndarray | None = None
    q0: np.ndarray | None = None


def tangent(trajectory: Trajectory, directions: Directions, every: int = 1) -> np.ndarray:
    """Return forward derivatives of a converged trajectory, dx (C, P, T', N+1, 3) [m] per unit
    step, at every `every`-th of its T times from the first on."""
    problem = trajectory.problem
    clips, steps, n = trajectory.q.shape[:3]
    ropes = len(problem.rods.length)
    many = next(item.shape[1] for item in directions if item is not None)
    change = {}
    for name, shape in shapes((*MOVING_ROD, *CLIP), n, T=steps).items():
        given, rows = getattr(directions, name), ropes if name in OF_ROD else clips
        change[name] = np.zeros((rows, *shape, many))
        if given is not None:
            change[name][:] = np.moveaxis(given, 1, -1)
    dx = np.zeros((clips, many, (steps - 1) // every + 1, n + 1, 3))
    tangent_clips(
        *problem, trajectory.v0, trajectory.x, trajectory.q, np.nan_to_num(trajectory.force),
        Change(**change), every, dx,
    )  # fmt: skip
    return dx
