"""Ropes in motion: the discrete rod with inertia, damping and driven ends, and its derivatives.

Second order in time, stable at any step: BDF2 with the constraint of a rope that does not stretch
met at every time (equations in `dynamics_kernels.py`). It damps by itself what it does not resolve:
a vibration of ω loses (ω h)⁴/4 of its amplitude a step (0.01 % at 3 Hz and 5 ms).

`simulate` is a differentiable function in torch, by the exact discrete adjoint, which keeps the
states only; `tangent` gives forward derivatives for least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.moving import Moving
from ropefit.solvers import dynamics_kernels as kernels
from ropefit.solvers.conditions import as_numpy
from ropefit.solvers.shapes import check_clips, check_shapes
from ropefit.solvers.turns import from_turn, to_turn

LIMIT = 50  # iterations in one step
GAUGE, FREE_GAUGE = 1e-9, 1e-4  # of the largest stiffness: holds a rope that is free to spin
WORDS = {
    kernels.CONVERGED: "converged",
    kernels.LIMIT: f"a step did not converge in {LIMIT} iterations: use smaller steps",
    kernels.NOT_FINITE: "a step left the numbers: use smaller steps",
}


class Drive(NamedTuple):
    """C clips of T times. time (C, T) [s], increasing; ends (C, T, 2, 3) [m], NaN for an end that
    is free, and clamp (C, T, 2, 4), NaN where not clamped (which ends are is the same in all)."""

    time: Tensor
    ends: Tensor
    clamp: Tensor

    def clips(self, index: np.ndarray | Tensor) -> Drive:
        """Some of the clips."""
        index = torch.as_tensor(index)
        return Drive(self.time[index], self.ends[index], self.clamp[index])


class Start(NamedTuple):
    """The first state: x (C, N+1, 3) [m], q (C, N, 4), v (C, N+1, 3) [m/s]."""

    x: Tensor
    q: Tensor
    v: Tensor


class Problem(NamedTuple):
    """R ropes, which of them each of C clips shows (C,), and how their ends are driven."""

    rods: kernels.Rod
    of: np.ndarray
    drives: kernels.Drive


@dataclass(frozen=True)
class Trajectory:
    """What came back: x (C, T, N+1, 3) [m], q (C, T, N, 4), force (C, T, N, 3) [N] in the segments,
    iterations (C, T), status (C,) and the steps done (C,); NaN after a step that failed. problem
    and v0 (C, N+1, 3) [m/s] are what was simulated: derivatives are those of a trajectory alone.
    Raises ShapeError where the arrays do not belong together."""

    x: np.ndarray
    q: np.ndarray
    force: np.ndarray
    iterations: np.ndarray
    status: np.ndarray
    done: np.ndarray
    problem: Problem = field(repr=False)
    v0: np.ndarray = field(repr=False)

    def __post_init__(self) -> None:
        check_clips(*self.problem)
        clips, steps = self.problem.drives.time.shape
        n = self.problem.rods.length.shape[1]
        check_shapes(
            x=(self.x, (clips, steps, n + 1, 3)),
            q=(self.q, (clips, steps, n, 4)),
            force=(self.force, (clips, steps, n, 3)),
            iterations=(self.iterations, (clips, steps)),
            status=(self.status, (clips,)),
            done=(self.done, (clips,)),
            v0=(self.v0, (clips, n + 1, 3)),
        )

    @property
    def converged(self) -> np.ndarray:
        return self.status == kernels.CONVERGED

    def why(self) -> str:
        """In words, of the first clip that failed."""
        bad = np.flatnonzero(~self.converged)
        if not bad.size:
            return WORDS[kernels.CONVERGED]
        return f"clip {bad[0]}, step {self.done[bad[0]]}: {WORDS[int(self.status[bad[0]])]}"


def problem_of(rope: Moving, drive: Drive, member: np.ndarray | None) -> Problem:
    """As compiled code wants it. Raises ValueError for what it does not do."""
    clips = len(drive.time)
    fields = [*rope.rod, rope.viscous, rope.loss, rope.mass, rope.air]
    dims = (1, 2, 2, 2, 2, 2, 2, 2, 1, 1)
    arrays = [
        as_numpy(f if f.ndim == d + 1 else f[None]) for f, d in zip(fields, dims, strict=True)
    ]
    ropes = max(len(a) for a in arrays)
    length, supple, stiff, rest, load, moment, viscous, loss, mass, air = (
        a if len(a) == ropes else np.repeat(a, ropes, axis=0) for a in arrays
    )
    if moment.any():
        raise ValueError("moments at the ends have no place in the dynamics")
    if member is None:
        if ropes not in (1, clips):
            raise ValueError(f"{ropes} ropes for {clips} clips: say which clip shows which")
        member = np.zeros(clips, np.int64) if ropes == 1 else np.arange(clips)
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1, keepdims=True), 0.0))
    spins = (stiff[:, 0, 2] == 0) & (stiff[:, -1, 2] == 0) & (rest[:, :, :2] == 0).all((1, 2))
    spins &= (stiff[:, :, 0] == stiff[:, :, 1]).all(1)
    # Where bending is damped, spinning is not quite free, and the matrix must be that of it; where
    # it is free, rounding must not turn the rope by more than an iteration may.
    small = np.where(loss.any((1, 2)), GAUGE, FREE_GAUGE)
    gauge = np.where(spins, small * stiff.max(axis=(1, 2), initial=1e-9), 0.0)
    rods = kernels.Rod(
        length, supple, viscous, stiff, loss, np.concatenate([real, rest], -1), load, mass, air,
        gauge,
    )  # fmt: skip
    ends = as_numpy(drive.ends)
    held = np.array([not np.isnan(ends[:, :, end]).any() for end in range(2)])
    drives = kernels.Drive(
        as_numpy(drive.time), np.nan_to_num(ends), np.nan_to_num(as_numpy(drive.clamp)), held
    )
    return Problem(rods, np.ascontiguousarray(member, dtype=np.int64), drives)


def solve(
    rope: Moving, drive: Drive, start: Start, member: np.ndarray | None = None, limit: int = LIMIT
) -> Trajectory:
    """Step through every clip. Never raises for a step that fails: the status says so."""
    problem = problem_of(rope, drive, member)
    clips, steps = problem.drives.time.shape
    n = problem.rods.length.shape[1]
    x, q = np.full((clips, steps, n + 1, 3), np.nan), np.full((clips, steps, n, 4), np.nan)
    force, iterations = np.full((clips, steps, n, 3), np.nan), np.zeros((clips, steps), np.int64)
    x[:, 0], q[:, 0], force[:, 0] = as_numpy(start.x), as_numpy(start.q), 0.0
    status, done, v0 = np.zeros(clips, np.int64), np.zeros(clips, np.int64), as_numpy(start.v)
    out = Trajectory(x, q, force, iterations, status, done, problem, v0)
    kernels.simulate_clips(*problem, v0, limit, x, q, force, iterations, status, done)
    for clip, last in enumerate(done):  # the step that failed holds numbers of no meaning
        q[clip, last:], force[clip, last:] = np.nan, np.nan
    force[:, 0] = np.nan
    return out


def simulate(
    rope: Moving, drive: Drive, start: Start, member: np.ndarray | None = None
) -> tuple[Tensor, Tensor, Trajectory]:
    """`solve` as a differentiable function: x (C, T, N+1, 3) [m], q (C, T, N, 4), how it went.

    Gradients reach every tensor of the rope, the drive (not its times) and the start. Raises
    ArithmeticError when a step fails.
    """
    trajectory = solve(rope, drive, start, member)
    if not trajectory.converged.all():
        raise ArithmeticError(trajectory.why())
    rod = rope.rod
    inputs = [
        rod.length, rod.supple, rope.viscous, rod.stiff, rope.loss, rod.rest, rod.load, rope.mass,
        rope.air, drive.ends, drive.clamp, start.x, start.v, start.q,
    ]  # fmt: skip
    x, q = _Simulate.apply(trajectory, *inputs)  # type: ignore[misc]
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
        out = _changes(clips, clips, steps, n)
        force = np.nan_to_num(s.force)
        turns = to_turn(s.q, as_numpy(grads[1]), 0.5)
        arguments = (*problem, s.v0, s.x, s.q, force, as_numpy(grads[0]).copy(), turns, out)
        kernels.adjoint_clips(*arguments)  # pyright: ignore[reportCallIssue]
        ropes = len(problem.rods.length)
        gradients = []
        for name, shape in zip(kernels.Change._fields, ctx.shapes, strict=True):
            value = getattr(out, name)
            if name in kernels.Rod._fields:
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

    Of R ropes, or one: length (R, P, N), supple and viscous (R, P, N, 3), stiff, loss, rest and
    load (R, P, N+1, 3), mass and air (R, P, N+1). Of C clips: ends (C, P, T, 2, 3), clamp
    (C, P, T, 2, 3) as turns [rad] about the clamp's own axes, x0 and v0 (C, P, N+1, 3), q0
    (C, P, N, 3) as turns.
    """

    length: np.ndarray | None = None
    supple: np.ndarray | None = None
    viscous: np.ndarray | None = None
    stiff: np.ndarray | None = None
    loss: np.ndarray | None = None
    rest: np.ndarray | None = None
    load: np.ndarray | None = None
    mass: np.ndarray | None = None
    air: np.ndarray | None = None
    ends: np.ndarray | None = None
    clamp: np.ndarray | None = None
    x0: np.ndarray | None = None
    v0: np.ndarray | None = None
    q0: np.ndarray | None = None


def tangent(trajectory: Trajectory, directions: Directions) -> tuple[np.ndarray, np.ndarray]:
    """Return forward derivatives of a converged trajectory: dx (C, P, T, N+1, 3) [m] and turns
    (C, P, T, N, 3) [rad] of the frames about their own directors, per unit step."""
    problem = trajectory.problem
    clips, steps, n = trajectory.q.shape[:3]
    ropes = len(problem.rods.length)
    many = next(item.shape[1] for item in directions if item is not None)
    shapes = _changes(1, 1, steps, n)
    change = []
    for name, given, shape in zip(kernels.Change._fields, directions, shapes, strict=True):
        rows = ropes if name in kernels.Rod._fields else clips
        wide = np.broadcast_to(0.0 if given is None else given, (rows, many, *shape.shape[1:]))
        change.append(np.array(wide, dtype=np.float64))
    dx, turn = np.zeros((clips, many, steps, n + 1, 3)), np.zeros((clips, many, steps, n, 3))
    kernels.tangent_clips(
        *problem, trajectory.v0, trajectory.x, trajectory.q, np.nan_to_num(trajectory.force),
        kernels.Change(*change), dx, turn,
    )  # fmt: skip
    return dx, turn


def _changes(ropes: int, clips: int, steps: int, n: int) -> kernels.Change:
    """Zeros of the shapes of a `Change`."""
    of_ropes = [(n,), (n, 3), (n, 3), *[(n + 1, 3)] * 4, (n + 1,), (n + 1,)]
    of_clips = [(steps, 2, 3), (steps, 2, 3), (n + 1, 3), (n + 1, 3), (n, 3)]
    return kernels.Change(
        *(np.zeros((ropes, *shape)) for shape in of_ropes),
        *(np.zeros((clips, *shape)) for shape in of_clips),
    )
