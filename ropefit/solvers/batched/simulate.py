"""Many clips at once, for accelerators: `dynamics.simulate` with the work done on a device.

The compiled loops themselves, with one thread a clip; gradients by the same discrete adjoint.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.fields import MOVING_ROD, names, shapes
from ropefit.rod.moving import Moving
from ropefit.solvers.batched.threads import filled, run_pull_back, run_simulate, spread, tensor
from ropefit.solvers.dynamics.kernels.records import CLIP, Change
from ropefit.solvers.dynamics.kernels.records import Drive as DriveArrays
from ropefit.solvers.dynamics.problem import (
    Drive,
    Problem,
    Start,
    check_clips,
    problem_of,
    ropes_in_motion,
    shown,
)
from ropefit.solvers.dynamics.solve import NEWTON_LIMIT, Trajectory, failure
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.status import Status

OF_ROD = names(MOVING_ROD)


@dataclass(frozen=True)
class Stepped:
    """C clips as they were simulated on a device: the fields of `Trajectory`, as tensors there.

    task: what was simulated, on the device; given: the same as it was given.
    """

    x: Tensor
    q: Tensor
    force: Tensor
    iterations: Tensor
    status: Tensor
    done: Tensor
    v0: Tensor
    task: Problem
    given: tuple[Moving, Drive, np.ndarray | None]

    @property
    def converged(self) -> Tensor:
        """Return (C,) bool: the clips of which every step converged."""
        return self.status == int(Status.CONVERGED)

    def why(self) -> str:
        """Return in words why the first clip that failed did."""
        return failure(self.status.cpu().numpy(), self.done.cpu().numpy())

    def trajectory(self) -> Trajectory:
        """Return the same on the host."""
        time = torch.arange(self.x.shape[1], device=self.x.device)
        lost = (time >= self.done[:, None])[..., None, None]
        q, force = (torch.where(lost, torch.nan, item) for item in (self.q, self.force))
        force[:, 0] = torch.nan
        found = (self.x, q, force, self.iterations, self.status, self.done)
        arrays = (np.ascontiguousarray(item.cpu().numpy()) for item in found)
        v0 = np.ascontiguousarray(self.v0.cpu().numpy())
        return Trajectory(*arrays, problem=problem_of(*self.given), v0=v0)


def step_batched(
    rope: Moving,
    drive: Drive,
    start: Start,
    device: torch.device | str,
    member: np.ndarray | None = None,
    limit: int = NEWTON_LIMIT,
) -> Stepped:
    """Step through every clip like `dynamics.solve`, on `device`.

    What is expanded over the clips (`Tensor.expand`, `np.broadcast_to`) is stored there once.
    Raises ValueError for what the dynamics does not do, ShapeError where the arrays do not belong
    together.
    """
    device = torch.device(device)
    task = _task(rope, drive, device, member)
    clips, steps = drive.time.shape
    n = task.rods.length.shape[1]
    first = Start(*map(tensor, start))
    check_shapes(
        x=(first.x, (clips, n + 1, 3)), q=(first.q, (clips, n, 4)), v=(first.v, (clips, n + 1, 3))
    )
    x, q, force = (
        filled((clips, steps, *rest), torch.nan, device) for rest in ((n + 1, 3), (n, 4), (n, 3))
    )
    x[:, 0], q[:, 0], force[:, 0] = spread(first.x, device), spread(first.q, device), 0.0
    iterations = filled((clips, steps), 0.0, device).long()
    status, done = (torch.zeros(clips, dtype=torch.int64, device=device) for _ in range(2))
    v0 = spread(first.v, device)
    arrays = (*task, v0, limit, x, q, force, iterations, status, done)
    run_simulate(clips, n, arrays, device)
    return Stepped(x, q, force, iterations, status, done, v0, task, (rope, drive, member))


def _task(rope: Moving, drive: Drive, device: torch.device, member: np.ndarray | None) -> Problem:
    """Return the problem on a device. Compare `problem_of`."""
    rows = ropes_in_motion(rope)
    ropes, clips = len(rows.gauge), len(drive.time)
    # A view: rows that are the same in all ropes are sent once.
    rods = type(rows)(*(torch.from_numpy(a).expand(ropes, *a.shape[1:]) for a in rows))
    time, ends, clamp = map(tensor, drive)
    drives = DriveArrays._make([
        spread(time, device), spread(_known(ends), device), spread(_known(clamp), device),
        ~torch.isnan(ends[:1]).any((0, 1, 3)).to(device),
    ])  # fmt: skip
    of = shown(ropes, clips, member)
    check_clips(Problem(rods, of, drives))
    rods = type(rods)(*(spread(field, device) for field in rods))
    return Problem._make([rods, torch.from_numpy(of).to(device), drives])


def _known(rows: Tensor) -> Tensor:
    """Return rows with zeros for NaN, expanded as they are."""
    distinct = rows[:1] if rows.stride(0) == 0 else rows
    return torch.nan_to_num(distinct).expand_as(rows)


def simulate_batched(
    rope: Moving,
    drive: Drive,
    start: Start,
    device: torch.device | str,
    member: np.ndarray | None = None,
) -> tuple[Tensor, Tensor, Stepped]:
    """Run `step_batched` as a differentiable function, like `dynamics.differentiable.simulate`.

    Returns x (C, T, N+1, 3) [m] and q (C, T, N, 4) on the device, and how it went. Raises
    ArithmeticError when a step fails.
    """
    found = step_batched(rope, drive, start, device, member)
    if not bool(found.converged.all()):
        raise ArithmeticError(found.why())
    given = rope.rod._asdict() | rope._asdict()
    inputs = [*(given[name] for name in OF_ROD), drive.ends, drive.clamp]
    x, q = _Simulate.apply(found, *inputs, start.x, start.v, start.q)  # type: ignore[misc]
    return x, q, found


class _Simulate(torch.autograd.Function):
    """The states of a trajectory already found; backward is the discrete adjoint."""

    @staticmethod
    def forward(ctx, found, *inputs):
        ctx.found = found
        ctx.like = [(tuple(t.shape), t.device) for t in inputs]
        ctx.set_materialize_grads(False)
        return found.x.clone(), found.q.clone()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_x, grad_q):
        s: Stepped = ctx.found
        clips, steps, n = s.q.shape[:3]
        device = s.x.device
        wanted = shapes((*MOVING_ROD, *CLIP), n, T=steps)
        out = Change(*(filled((clips, *wanted[n]), 0.0, device) for n in Change._fields))
        # Both are used up.
        gx = filled(s.x.shape, 0.0, device) if grad_x is None else spread(grad_x, device).clone()
        gq = filled(s.force.shape, 0.0, device)
        if grad_q is not None:
            gq += _to_turn(s.q, grad_q)
        force = torch.nan_to_num(s.force)
        run_pull_back(clips, steps, n, (*s.task, s.v0, s.x, s.q, force, gx, gq, out), device)
        gradients, clamp = [], cast(Tensor, s.task.drives.clamp)
        needed = ctx.needs_input_grad[1:]
        for name, needs, (shape, home) in zip(Change._fields, needed, ctx.like, strict=True):
            if not needs:
                gradients.append(None)
                continue
            value = getattr(out, name)
            if name in OF_ROD:
                total = value.new_zeros(len(s.task.rods.length), *value.shape[1:])
                total.index_add_(0, s.task.of, value)
                value = total if len(shape) == value.ndim else total.sum(0)
            elif name == "clamp":
                value = _of_turn(clamp, value)
            elif name == "q0":
                value = _of_turn(s.q[:, 0], value)
            gradients.append(value.reshape(shape).to(home))
        return None, *gradients


def _to_turn(q: Tensor, gradient: Tensor) -> Tensor:
    """Return the gradient in a turn about q's own axes from that in q. Compare `to_turn`."""
    w, v = q[..., :1], q[..., 1:]
    g, h = gradient[..., :1], gradient[..., 1:]
    return 0.5 * (w * h - g * v - torch.linalg.cross(v, h))


def _of_turn(q: Tensor, turn: Tensor) -> Tensor:
    """Return the gradient in q (of unit length) from that in a turn. Compare `from_turn`."""
    w, v = q[..., :1], q[..., 1:]
    real = -(v * turn).sum(-1, keepdim=True)
    return 2.0 * torch.cat([real, w * turn + torch.linalg.cross(v, turn)], -1)
