"""Many clips at once, for accelerators: `dynamics.simulate` with the work done on a device.

The same steps, iterations and stopping rule as the compiled path, all clips together; gradients by
the discrete adjoint, which keeps the states only and makes each step again on the way back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.fields import MOVING_ROD, names
from ropefit.rod.moving import Moving
from ropefit.solvers.batched.moving import (
    Clips,
    Drives,
    Factor,
    Known,
    Past,
    advanced,
    bends,
    combined,
    darboux,
    eliminated,
    factor,
    known,
    matrix,
    nodes,
    rates,
    residual,
    resistance,
    segments,
    strains,
)
from ropefit.solvers.batched.ropes import turned
from ropefit.solvers.dynamics.kernels.simulate import PATIENCE, REACH, SPIN_LIMIT, TURN_LIMIT
from ropefit.solvers.dynamics.problem import Drive, Problem, Start, problem_of
from ropefit.solvers.dynamics.solve import LIMIT, Trajectory
from ropefit.solvers.status import Status

FIELDS = names(MOVING_ROD)


def solve_batched(
    rope: Moving,
    drive: Drive,
    start: Start,
    device: torch.device | str,
    member: np.ndarray | None = None,
    limit: int = LIMIT,
) -> Trajectory:
    """Step through every clip like `dynamics.solve`, on `device`.

    Raises ValueError for a rope that touches bodies.
    """
    if bool(rope.bodies.any()):
        raise ValueError("what a rope touches is stepped one clip after the other only")
    problem = problem_of(rope, drive, member)
    task = _task(problem, torch.device(device))
    x0, q0, v0 = (a.detach().to(device, torch.float64) for a in start)
    with torch.no_grad():
        found = _stepped(task, x0, q0, v0, limit)
    x, q, force, iterations, status, done = (t.cpu().numpy() for t in found)
    return Trajectory(x, q, force, iterations, status, done, problem, v0.cpu().numpy())


def simulate_batched(
    rope: Moving,
    drive: Drive,
    start: Start,
    device: torch.device | str,
    member: np.ndarray | None = None,
) -> tuple[Tensor, Tensor, Trajectory]:
    """Run `solve_batched` as a differentiable function, like `dynamics.derivatives.simulate`.

    Returns x (C, T, N+1, 3) [m] and q (C, T, N, 4) on the device, and how it went. Raises
    ArithmeticError when a step fails.
    """
    found = solve_batched(rope, drive, start, device, member)
    if not found.converged.all():
        raise ArithmeticError(found.why())
    task = _task(found.problem, torch.device(device))
    of = torch.from_numpy(found.problem.of).to(device)
    given = rope.rod._asdict() | rope._asdict()
    fields = []
    for name, like in zip(FIELDS, task.clips, strict=False):
        value = given[name].to(device, torch.float64)
        value = value if value.ndim == like.ndim else value[None]
        fields.append(value[of] if len(value) > 1 else value.expand_as(like))
    moved = (torch.nan_to_num(t.to(device, torch.float64)) for t in (drive.ends, drive.clamp))
    first = (t.to(device, torch.float64) for t in (start.x, start.v, start.q))
    x, q = _Simulate.apply(found, task, *fields, *moved, *first)  # type: ignore[misc]
    return x, q, found


@dataclass(frozen=True)
class _Task:
    """B clips on a device: time (B, T) [s], ends (B, T, 2, 3), clamp (B, T, 2, 4)."""

    clips: Clips
    time: Tensor
    ends: Tensor
    clamp: Tensor
    held: tuple[bool, bool]

    def drives(self, t: int) -> Drives:
        return Drives(self.ends[:, t], self.clamp[:, t], self.held)


def _task(problem: Problem, device: torch.device) -> _Task:
    rods, of, drives = problem
    arrays = rods._asdict() | {"rest": rods.rest[..., 1:]}
    clips = Clips._make(torch.from_numpy(arrays[n][of]).to(device) for n in (*FIELDS, "gauge"))
    time, ends, clamp = (torch.from_numpy(a).to(device) for a in drives[:3])
    return _Task(clips, time, ends, clamp, (bool(drives.held[0]), bool(drives.held[1])))


def _state(task: _Task, t: int, x: Tensor, q: Tensor, v: Tensor) -> Past:
    """Return what later steps need of a state."""
    p = darboux(task.clips, task.clamp[:, t], q)[..., 1:]
    return Past(x, v, p, strains(task.clips, x, q))


def _stepped(
    task: _Task, x0: Tensor, q0: Tensor, v0: Tensor, limit: int
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return x, q, force of all times, iterations (B, T), status and steps done (B,)."""
    clips, (count, steps) = task.clips, task.time.shape
    xs, qs = ([first] + [torch.full_like(first, torch.nan)] * (steps - 1) for first in (x0, q0))
    forces = [torch.full_like(clips.flexibility, torch.nan) for _ in range(steps)]
    iterations = torch.zeros(count, steps, dtype=torch.int64, device=x0.device)
    status = torch.full((count,), int(Status.CONVERGED), dtype=torch.int64, device=x0.device)
    done = torch.full((count,), steps, dtype=torch.int64, device=x0.device)
    one = two = _state(task, 0, x0, q0, v0)
    force = torch.zeros_like(clips.flexibility)
    for t in range(1, steps):
        c0, c1, c2 = rates(task.time, t)
        air = resistance(clips, task.time, t, one.v, two.v)
        k = known(clips, task.drives(t), c0, combined(c1, c2, one, two), air)
        q = q0 if t == 1 else _gone_on(qs[t - 2], qs[t - 1])
        q, force, iterations[:, t], how = _newton(task, t, k, q, force, limit)
        bad = (how != int(Status.CONVERGED)) & (status == int(Status.CONVERGED))
        status, done = torch.where(bad, how, status), torch.where(bad, t, done)
        good = (status == int(Status.CONVERGED))[:, None, None]
        nan = torch.full_like(q[:1, :1, :1], torch.nan)
        qs[t], forces[t] = torch.where(good, q, nan), torch.where(good, force, nan)
        xs[t] = torch.where(good, nodes(k, force), nan)
        if not bool(good.any()):
            break
        one, two = _state(task, t, xs[t], qs[t], c0[:, None, None] * xs[t] + k.past.x), one
    x, q, force = (torch.stack(a, 1) for a in (xs, qs, forces))
    return x, q, force, iterations, status, done


def _gone_on(a: Tensor, b: Tensor) -> Tensor:
    """Return frames (B, N, 4) as the turn from a to b goes on: b a* b."""
    q = 2 * (a * b).sum(-1, keepdim=True) * b - a
    return q / torch.linalg.norm(q, dim=-1, keepdim=True)


def _newton(
    task: _Task, t: int, k: Known, q: Tensor, force: Tensor, limit: int
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return frames, forces, iterations (B,) and status (B,) of one step, from q and force on."""
    clips, count = task.clips, len(q)
    clamp = task.clamp[:, t]
    damped = (clips.bend_viscosity != 0).any(-1).any(-1)
    most = torch.where(clips.gauge > 0, SPIN_LIMIT, torch.inf).to(q)
    most = torch.where((clips.gauge > 0) & ~damped, 0.0, most)
    going = torch.isfinite(q).all(-1).all(-1)
    status = torch.where(going, int(Status.LIMIT), int(Status.NOT_FINITE))
    iterations = torch.full((count,), limit, dtype=torch.int64, device=q.device)
    for iteration in range(limit):
        b, s = bends(clips, k, clamp, q), segments(clips, k, q, force)
        step = eliminated(factor(*matrix(clips, k, s, b)), residual(k, s, b, force))
        spin = step[:, 0, 2] - torch.minimum(torch.maximum(step[:, 0, 2], -most), most)
        turn, change = step[..., :3].clone(), step[..., 3:]
        turn[..., 2] -= spin[:, None]
        size = turn.abs().amax((1, 2))
        pull, most = change.abs().amax((1, 2)), force.abs().amax((1, 2))
        broken = going & ~(torch.isfinite(size) & torch.isfinite(pull))
        going = going & ~broken
        status[broken] = int(Status.NOT_FINITE)
        arrived = going & (size < REACH) & (pull < REACH * (most + pull) + 1e-300)
        longest = torch.full_like(
            size, 1.0 if iteration < PATIENCE else 0.5 ** (iteration // PATIENCE)
        )
        longest[arrived] = 1.0
        share = torch.minimum(longest, TURN_LIMIT / size.clamp_min(1e-300))[:, None, None]
        q = torch.where(going[:, None, None], turned(q, -share * turn), q)
        force = torch.where(going[:, None, None], force - share * change, force)
        status[arrived], iterations[arrived] = int(Status.CONVERGED), iteration + 1
        going = going & ~arrived
        if not bool(going.any()):
            break
    return q, force, iterations, status


class _Simulate(torch.autograd.Function):
    """The states of a trajectory already found; backward is the discrete adjoint."""

    @staticmethod
    def forward(ctx, found, task, *inputs):
        ctx.found, ctx.task = found, task
        ctx.save_for_backward(*inputs)
        device = task.time.device
        x, q = (torch.from_numpy(a).to(device) for a in (found.x, found.q))
        ctx.states = x, q, torch.from_numpy(np.nan_to_num(found.force)).to(device)
        return x.clone(), q.clone()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_x, grad_q):
        task, (x, q, force) = ctx.task, ctx.states
        *fields, ends, clamp, x0, v0, q0 = ctx.saved_tensors
        past = _pasts(task, x, q, v0)
        total = [torch.zeros_like(f) for f in fields]
        ends_total, clamp_total = torch.zeros_like(ends), torch.zeros_like(clamp)
        back = [Past(*(torch.zeros_like(f) for f in past[0])) for _ in past]
        for t in range(x.shape[1] - 1, 0, -1):
            one, two = past[t - 1], past[max(t - 2, 0)]
            leaves = [
                f.detach().requires_grad_() for f in (*fields, ends[:, t], clamp[:, t], *one, *two)
            ]
            with torch.enable_grad():
                state, turned_q = _again(task, t, leaves, q[:, t], force[:, t])
            given = [back[t].x + grad_x[:, t], *back[t][1:], grad_q[:, t]]
            found = torch.autograd.grad((*state, turned_q), leaves, given, allow_unused=True)
            found = [
                torch.zeros_like(b) if a is None else a for a, b in zip(found, leaves, strict=True)
            ]
            m = len(fields)
            total = [a + b for a, b in zip(total, found[:m], strict=True)]
            ends_total[:, t], clamp_total[:, t] = found[m], found[m + 1]
            back[t - 1] = Past(
                *(a + b for a, b in zip(back[t - 1], found[m + 2 : m + 6], strict=True))
            )
            if t > 1:
                back[t - 2] = Past(
                    *(a + b for a, b in zip(back[t - 2], found[m + 6 :], strict=True))
                )
        leaves = [f.detach().requires_grad_() for f in (*fields, clamp[:, 0], x0, v0, q0)]
        with torch.enable_grad():
            first = _first(task, leaves)
        given = [back[0].x + grad_x[:, 0], *back[0][1:], grad_q[:, 0]]
        found = torch.autograd.grad(first, leaves, given, allow_unused=True)
        found = [
            torch.zeros_like(b) if a is None else a for a, b in zip(found, leaves, strict=True)
        ]
        m = len(fields)
        total = [a + b for a, b in zip(total, found[:m], strict=True)]
        clamp_total[:, 0] = found[m]
        return None, None, *total, ends_total, clamp_total, *found[m + 1 :]


def _pasts(task: _Task, x: Tensor, q: Tensor, v0: Tensor) -> list[Past]:
    """Return the states of all times, with their speeds."""
    out = [_state(task, 0, x[:, 0], q[:, 0], v0)]
    for t in range(1, x.shape[1]):
        c0, c1, c2 = (c[:, None, None] for c in rates(task.time, t))
        v = c0 * x[:, t] + c1 * x[:, t - 1] + c2 * x[:, max(t - 2, 0)]
        out.append(_state(task, t, x[:, t], q[:, t], v))
    return out


def _unit(q: Tensor) -> Tensor:
    """Return quaternions of length one, zeros as they are: derivatives are those of turns."""
    return q / torch.linalg.norm(q, dim=-1, keepdim=True).clamp_min(1e-300)


def _again(
    task: _Task, t: int, leaves: list[Tensor], q: Tensor, force: Tensor
) -> tuple[Past, Tensor]:
    """Return the state at time t as a function of `leaves`: the rope's fields, ends and clamps
    then, and the two states before."""
    m = len(FIELDS)
    clips = Clips._make([*leaves[:m], task.clips.gauge])
    drives = Drives(leaves[m], _unit(leaves[m + 1]), task.held)
    one, two = Past._make(leaves[m + 2 : m + 6]), Past._make(leaves[m + 6 :])
    c0, c1, c2 = rates(task.time, t)
    air = resistance(clips, task.time, t, one.v, two.v)
    k = known(clips, drives, c0, combined(c1, c2, one, two), air)
    f = _factor(clips, k, drives, q, force)
    return advanced(clips, drives, k, q, force, f)


@torch.no_grad()
def _factor(clips: Clips, k: Known, drives: Drives, q: Tensor, force: Tensor) -> Factor:
    b, s = bends(clips, k, drives.clamp, q), segments(clips, k, q, force)
    return factor(*matrix(clips, k, s, b))


def _first(task: _Task, leaves: list[Tensor]) -> tuple[Tensor, ...]:
    """Return the first state and its frames as functions of fields, clamps, x, v and q then."""
    m = len(FIELDS)
    clips = Clips._make([*leaves[:m], task.clips.gauge])
    clamp, x, v, q = _unit(leaves[m]), leaves[m + 1], leaves[m + 2], _unit(leaves[m + 3])
    return x, v, darboux(clips, clamp, q)[..., 1:], strains(clips, x, q), q
