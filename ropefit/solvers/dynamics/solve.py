"""Ropes in motion: the discrete rod with inertia, damping and driven ends, and its derivatives.

Second order in time, stable at any step: BDF2 with the constraint of a rope that does not stretch
met at every time (equations in `kernels/`). It damps by itself what it does not resolve:
a vibration of ω loses (ω h)⁴/4 of its amplitude a step (0.01 % at 3 Hz and 5 ms).

`derivatives.py` differentiates what `solve` finds, `differentiable.py` in torch.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ropefit.rod.moving import Moving
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.dynamics.kernels.entries import simulate_clips
from ropefit.solvers.dynamics.problem import Drive, Problem, Start, check_clips, problem_of
from ropefit.solvers.shapes import check_shapes
from ropefit.solvers.status import Status

NEWTON_LIMIT = 50  # iterations in one step


@dataclass(frozen=True)
class Trajectory:
    """C clips of T times as they were simulated.

    x (C, T, N+1, 3) [m], q (C, T, N, 4), force (C, T, N, 3) [N] in the segments, iterations (C, T),
    status (C,) of `Status` and the steps done (C,); NaN after a step that failed. problem and v0
    (C, N+1, 3) [m/s] are what was simulated: derivatives are those of a trajectory alone. Raises
    ShapeError where the arrays do not belong together.
    """

    x: np.ndarray
    q: np.ndarray
    force: np.ndarray
    iterations: np.ndarray
    status: np.ndarray
    done: np.ndarray
    problem: Problem = field(repr=False)
    v0: np.ndarray = field(repr=False)

    def __post_init__(self) -> None:
        check_clips(self.problem)
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
        """Return (C,) bool: the clips of which every step converged."""
        return self.status == Status.CONVERGED

    def why(self) -> str:
        """Return in words why the first clip that failed did."""
        return failure(self.status, self.done)


def failure(status: np.ndarray, done: np.ndarray) -> str:
    """Return in words why the first clip that failed did; status (C,) and steps done (C,)."""
    bad = np.flatnonzero(status != Status.CONVERGED)
    if not bad.size:
        return Status.CONVERGED.advice
    return f"clip {bad[0]}, step {done[bad[0]]}: {Status(int(status[bad[0]])).step_advice}"


def solve(
    rope: Moving,
    drive: Drive,
    start: Start,
    member: np.ndarray | None = None,
    limit: int = NEWTON_LIMIT,
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
    simulate_clips(*problem, v0, limit, x, q, force, iterations, status, done)
    for clip, last in enumerate(done):  # the step that failed holds numbers of no meaning
        q[clip, last:], force[clip, last:] = np.nan, np.nan
    force[:, 0] = np.nan
    return out
