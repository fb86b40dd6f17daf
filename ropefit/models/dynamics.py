"""From parameters to where a moving rope would be seen, and its derivatives.

A `Forward` whose rope has inertia: its frames form clips, and each clip is stepped through open
loop from its first two frames, so that `fit` and all that follows it work on motion as on shapes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from ropefit.models.equilibrium import Forward
from ropefit.models.response import STEP as RESPONSE
from ropefit.models.response import Point, slope, turn_slope
from ropefit.rod.moving import Moving, moving, undamped
from ropefit.rod.setup import Setup
from ropefit.runs.journal import Arrays
from ropefit.solvers.dynamics.derivatives import Directions, tangent
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.solve import solve as settle
from ropefit.solvers.equilibrium.turns import to_turn

SPRING = 2e-4  # m per weight of the rope: compliance of what pulls the first states to the data
STEP = 1e-4  # of a search variable: the first states' differences
FAILED = 1  # status of frames that were not reached


FINENESS = (1, 2, 4)  # steps for each frame: more where fewer do not converge


class Run(NamedTuple):
    """One clip as it was simulated, with `fine` steps from frame to frame."""

    drive: Drive
    start: Start
    trajectory: Trajectory
    fine: int


@dataclass
class MotionPoint(Point):
    """A `Point` that also knows its rope in motion and how each clip went."""

    rope: Moving
    runs: list[Run]


@dataclass
class MotionForward(Forward):
    """time (F,) [s]; clips: indices of the frames of each; observed (F, K, 3) [m]: centrelines,
    at every `every`-th node, of which the first two of a clip are its start."""

    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    clips: list[np.ndarray] = field(default_factory=list)
    observed: np.ndarray = field(default_factory=lambda: np.empty(0))
    every: int = 1

    def at(self, u: np.ndarray, start: States | None = None) -> MotionPoint:
        """Simulate at u. Frames that were not reached are NaN in `seen`, and marked."""
        setup = self.setup_at(u)
        rope = rope_of(setup)
        frames, n = len(self.time), setup.segments
        x, q = np.full((frames, n + 1, 3), np.nan), np.full((frames, n, 4), np.nan)
        force, status = np.full((frames, n, 3), np.nan), np.full(frames, FAILED)
        iterations, runs = np.zeros(frames, dtype=np.int64), []
        for clip in self.clips:
            run = self._run(setup, rope, clip)
            found = run.trajectory
            reached = clip[: 1 + (found.done[0] - 1) // run.fine]
            frames_of = slice(None, len(reached) * run.fine, run.fine)
            x[reached], q[reached] = found.x[0, frames_of], found.q[0, frames_of]
            force[reached] = found.force[0, frames_of]
            status[reached], iterations[clip] = 0, found.iterations[0, :: run.fine]
            runs.append(run)
        seen = setup.seen(torch.from_numpy(x)).numpy().copy()
        held = Conditions(setup.ends, setup.clamp)
        unknown = np.full((frames, held.supports), np.nan)  # no rest: no reactions either
        solution = Solution(
            q, x, x[:, 0], unknown, force, status, iterations, np.zeros(frames), rope.rod, held
        )
        return MotionPoint(u, setup, solution, seen, rope, runs)

    def kept(self, point: Point) -> Arrays:
        """Nothing: a motion is simulated from its start again, and long."""
        return {}

    def restored(self, u: np.ndarray, arrays: Arrays) -> MotionPoint:
        return self.at(u)

    def jacobian(self, point: Point) -> np.ndarray:
        """(P, F, K, 3) derivative of `seen` in the search variables, zero in clips that failed."""
        assert isinstance(point, MotionPoint)
        x = torch.from_numpy(point.solution.x)
        now, rods, ends, clamps, direct = point.setup, [], [], [], []
        for changed in self.changes(point.u):
            a, b = changed(-RESPONSE), changed(RESPONSE)
            pairs = zip(fields(rope_of(a)), fields(rope_of(b)), strict=True)
            rods.append([slope(p, q) for p, q in pairs])
            ends.append(slope(a.ends, b.ends))
            clamps.append(turn_slope(now.clamp, a.clamp, b.clamp))
            direct.append(slope(a.seen(x), b.seen(x)))
        out = np.array(direct).reshape(len(point.u), *point.seen.shape)
        by_rod = [np.stack([row[k] for row in rods])[None] for k in range(len(rods[0]))]
        moved, turned = np.stack(ends), np.stack(clamps)
        starts = [self._start_change(point, k) for k in range(len(point.u))]
        for number, (clip, run) in enumerate(zip(self.clips, point.runs, strict=True)):
            if not run.trajectory.converged[0]:
                continue
            first = [np.stack([s[number][k] for s in starts])[None] for k in range(3)]
            path = [finer(self.time[clip], v[:, clip], run.fine, 1)[None] for v in (moved, turned)]
            directions = Directions(*by_rod, *path, *first)
            dx, _ = tangent(run.trajectory, directions)
            out[:, clip] += dx[0][:, :: run.fine]
        return out

    def _run(self, setup: Setup, rope: Moving, clip: np.ndarray) -> Run:
        """Simulate one clip, with more steps if it needs them."""
        drive = self._drive(setup, clip)
        for fine in FINENESS:
            refined = refine(drive, fine)
            first = self._first(rope, drive, clip)
            found = solve(rope, refined, first)
            if found.converged[0]:
                break
        return Run(refined, first, found, fine)

    def _drive(self, setup: Setup, clip: np.ndarray) -> Drive:
        index = torch.from_numpy(clip)
        time = torch.from_numpy(self.time[clip])
        return Drive(time[None], setup.ends[index][None], setup.clamp[index][None])

    def _first(self, rope: Moving, drive: Drive, clip: np.ndarray) -> Start:
        return first_state(rope, drive, self.observed[clip[:2]], self.every)

    def _start_change(self, point: MotionPoint, k: int) -> list[tuple[np.ndarray, ...]]:
        """Derivative of every clip's first state in the k-th variable: x0, v0, turn of q0."""
        sides = []
        for side in (-1, 1):
            u = point.u.copy()
            u[k] += side * STEP
            setup = self.setup_at(u)
            rope = rope_of(setup)
            sides.append([self._first(rope, self._drive(setup, c[:2]), c) for c in self.clips])
        out = []
        for low, high, run in zip(*sides, point.runs, strict=True):
            x, q, v = ((b - a).numpy()[0] / (2 * STEP) for a, b in zip(low, high, strict=True))
            out.append((x, v, to_turn(run.start.q.numpy()[0], q, 2.0)))
        return out


def rope_of(setup: Setup) -> Moving:
    """The rope of a setup in motion."""
    p = setup.properties
    return moving(p, setup.rod(), setup.damping or undamped(p))


def first_state(rope: Moving, drive: Drive, observed: np.ndarray, every: int) -> Start:
    """The state of a clip's first time, from its first two frames observed (2, K, 3) [m].

    Each of the two is the equilibrium of the rope that springs pull to what was observed; the speed
    is the one from which the rope, in one step, gets from the first to the second.
    """
    inner = np.arange(1, observed.shape[1] - 1)
    node, weight = np.repeat(inner * every, 3), float(rope.rod.load.norm(dim=-1).sum())
    across = torch.eye(3, dtype=torch.float64).repeat(len(inner), 1)[None]
    states, last = [], None
    for t in (0, 1):
        seen = np.isfinite(observed[t, inner]).all(-1)
        pulled = Conditions(
            drive.ends[:, t],
            drive.clamp[:, t],
            node,
            across,
            torch.from_numpy(np.nan_to_num(observed[t, inner]).reshape(1, -1)),
            torch.full((1, len(node)), SPRING / weight, dtype=torch.float64),
            np.repeat(seen, 3)[None],
        )
        last = settle(rope.rod, pulled, last)
        states.append(last)
    x0, x1, q0 = (torch.from_numpy(a) for a in (states[0].x, states[1].x, states[0].q))
    step = float(drive.time[0, 1] - drive.time[0, 0])
    v = (x1 - x0) / step
    once = Drive(drive.time[:, :2], drive.ends[:, :2], drive.clamp[:, :2])
    for _ in range(3):
        arrived = torch.from_numpy(solve(rope, once, Start(x0, q0, v)).x[:, 1])
        v = v + torch.nan_to_num(x1 - arrived) / step
    return Start(x0, q0, v)


def refine(drive: Drive, fine: int) -> Drive:
    """The drive of one clip with `fine` steps for each of its own."""
    if fine == 1:
        return drive
    time = drive.time[0].numpy()
    ends = finer(time, drive.ends[0].numpy(), fine)
    clamp = finer(time, drive.clamp[0].numpy(), fine)
    clamp /= np.linalg.norm(clamp, axis=-1, keepdims=True)
    times = torch.from_numpy(_between(time, fine))[None]
    return Drive(times, torch.from_numpy(ends)[None], torch.from_numpy(clamp)[None])


def finer(time: np.ndarray, values: np.ndarray, fine: int, axis: int = 0) -> np.ndarray:
    """Values at time (T,) on a spline through them, `fine` for each interval. What is NaN at some
    time is so at all."""
    if fine == 1:
        return values
    known = np.isfinite(values).all(axis=axis, keepdims=True)
    curve = CubicSpline(time, np.nan_to_num(values), axis=axis)(_between(time, fine))
    return np.where(known, curve, np.nan)


def _between(time: np.ndarray, fine: int) -> np.ndarray:
    places = np.arange((len(time) - 1) * fine + 1) / fine
    return np.interp(places, np.arange(len(time)), time)


def fields(rope: Moving) -> list[torch.Tensor]:
    """In the order of `Directions`."""
    rod = rope.rod
    return [
        rod.length, rod.flexibility, rope.strain_viscosity, rod.stiffness, rope.bend_viscosity,
        rod.rest, rod.load, rope.mass, rope.air,
    ]  # fmt: skip
