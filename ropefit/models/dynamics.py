"""The rope in motion: each clip stepped through time, open loop, with the exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.models import mesh
from ropefit.models.first_state import SMOOTHED, FirstStates, begun_smoothly, first_states
from ropefit.models.model import Model
from ropefit.models.response import Parts, Point
from ropefit.models.slopes import Change
from ropefit.rod.differences import DIFFERENCE_STEP as RESPONSE
from ropefit.rod.differences import sensor_slope, slope, turn_slope
from ropefit.rod.fields import MOVING_ROD, names
from ropefit.rod.moving import Moving, moving, undamped
from ropefit.rod.setup import Setup
from ropefit.runs.journal import Arrays
from ropefit.runs.threads import threads
from ropefit.solvers.dynamics.derivatives import Directions, tangent
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.status import Status

Done = TypeVar("Done")
SAME_STEP = 1e-3  # of a step: rounding of times
LONGEST_STEP = 0.005  # s: at 0.01 s a rope comes out some 5 % too stiff
FINER = (1, 2, 4)  # times as many steps where fewer do not converge


class Run(NamedTuple):
    """One clip as it was simulated, with `fine` steps from frame to frame."""

    drive: Drive
    trajectory: Trajectory
    fine: int


@dataclass
class MotionPoint(Point):
    """A `Point` of a rope in motion: how each clip began and went."""

    model: Dynamics
    first: FirstStates
    runs: list[Run]

    @property
    def converged(self) -> np.ndarray:
        """Return (F,) bool: not in the frames that a failed clip did not reach."""
        simulated = np.isin(np.arange(len(self.seen)), np.concatenate(self.model.clips))
        return self.solution.converged | ~simulated

    def respond(self, changes: list[Change]) -> np.ndarray:
        """Return (P, F, K, 3) first-order changes of the nodes as seen, zero in clips that
        failed."""
        out = np.zeros((len(changes), *self.seen.shape))
        for frames, moved in self.parts(changes):
            out[:, frames] = moved
        return out

    def parts(
        self, changes: list[Change], turned: bool = False, nodes: np.ndarray | None = None
    ) -> Parts:
        """Yield the frames of each clip, and `respond` there: of all clips together it is large."""
        if not changes:
            return
        x, now = self.solution.x, self.setup
        rods, ends, clamps, sensor = [], [], [], []
        for changed in changes:
            a, b = changed(-RESPONSE), changed(RESPONSE)
            low, high = fields_of(rope_of(a)), fields_of(rope_of(b))
            rods.append({name: slope(low[name], high[name]) for name in low})
            ends.append(slope(a.ends, b.ends))
            clamps.append(turn_slope(now.clamp, a.clamp, b.clamp))
            sensor.append(sensor_slope(a, b, x))
        rod = {name: np.stack([row[name] for row in rods])[None] for name in rods[0]}
        path = np.stack(ends), np.stack(clamps)
        both = np.array([clip[:2] for clip in self.model.clips])
        begin = self.first.respond(rod, *(np.moveaxis(v[:, both], 0, 1) for v in path))

        def part(number: int) -> tuple[np.ndarray, np.ndarray]:
            clip, run = self.model.clips[number], self.runs[number]
            if run.trajectory.converged[0]:
                time = self.model.time[clip]
                driven = [finer(time, v[:, clip], run.fine, 1)[None] for v in path]
                x0, v0, q0 = (v[number : number + 1] for v in begin)
                directions = Directions(**rod, ends=driven[0], clamp=driven[1], x0=x0, v0=v0, q0=q0)
                out = tangent(run.trajectory, directions, run.fine)[0]
            else:
                out = np.zeros((len(changes), len(clip), *self.seen.shape[1:]))
            for moved, own in zip(out, sensor, strict=True):
                moved += own[clip] if own.ndim == 3 else own
            return clip, out if nodes is None else out[:, :, nodes]

        many = threads()
        for k in range(0, len(self.runs), many):
            yield from _each(part, range(k, min(k + many, len(self.runs))))


@dataclass
class Dynamics(Model):
    """Clips of one rope, each from its first two frames on.

    time (F,) [s]; observed (F, K, 3) [m]: centrelines, at every `every`-th node; finer: times as
    many steps as `LONGEST_STEP` asks for; mesh_error (F, N+1, 3) [m]: added to what is simulated.
    """

    time: np.ndarray = field(default_factory=lambda: np.empty(0))
    observed: np.ndarray = field(default_factory=lambda: np.empty(0))
    every: int = 1
    finer: int = 1
    mesh_error: np.ndarray | None = None

    instantaneous: ClassVar[bool] = False

    def at(self, u: np.ndarray, start: States | None = None) -> MotionPoint:
        """Simulate at u. Frames that were not reached are NaN in `seen`, and marked."""
        setup = self.setup_at(u)
        rope = rope_of(setup)
        frames, n = len(self.time), setup.segments
        x, q = np.full((frames, n + 1, 3), np.nan), np.full((frames, n, 4), np.nan)
        force = np.full((frames, n, 3), np.nan)
        status = np.full(frames, int(Status.LIMIT))
        iterations = np.zeros(frames, dtype=np.int64)
        first = self._first(setup, rope)
        runs: list[Run] = [None] * len(self.clips)  # type: ignore[list-item]

        def run(number: int) -> None:
            begin = Start(*(item[number : number + 1] for item in first.start))
            runs[number] = self._run(setup, rope, self.clips[number], begin)

        _each(run, range(len(runs)))
        for clip, went in zip(self.clips, runs, strict=True):
            found = went.trajectory
            reached = clip[: 1 + (found.done[0] - 1) // went.fine]
            frames_of = slice(None, len(reached) * went.fine, went.fine)
            x[reached], q[reached] = found.x[0, frames_of], found.q[0, frames_of]
            force[reached] = found.force[0, frames_of]
            status[reached], iterations[clip] = 0, found.iterations[0, :: went.fine]
        seen = setup.sensor(x).copy()
        if self.mesh_error is not None:
            seen += self.mesh_error
        held = Conditions(setup.ends, setup.clamp)
        unknown = np.full((frames, held.supports), np.nan)  # no rest: no reactions either
        solution = Solution(
            q, x, x[:, 0], unknown, force, status, iterations, np.zeros(frames), rope.rod, held
        )
        return MotionPoint(u, setup, solution, seen, self, first, runs)

    def corrected(self, u: np.ndarray) -> Self:
        """Return the model with the error of its mesh and steps at u added to all it predicts.

        That error changes little with u: derivatives leave it out (deferred correction).
        """
        base = mesh.refined(self.base)
        if base is None:
            return self
        plain = replace(self, mesh_error=None)
        fine = replace(
            plain, base=base, every=mesh.FINER * self.every, finer=mesh.FINER * self.finer
        )
        error, many = np.zeros((len(self.time), self.base.segments + 1, 3)), threads()
        for k in range(0, len(self.clips), many):  # of all clips together it is large
            few = self.clips[k : k + many]
            coarse, finest = (replace(one, clips=few).at(u).seen for one in (plain, fine))
            error += mesh.mesh_error(coarse, finest)
        return replace(self, mesh_error=error)

    def kept(self, point: Point) -> Arrays:
        """Return nothing: a motion is simulated from its start again, and long."""
        return {}

    def restored(self, u: np.ndarray, arrays: Arrays) -> MotionPoint:
        return self.at(u)

    def horizon(self, seconds: float, most: float = np.inf) -> Self:
        """Return the model that begins anew every so often, from what was observed there, in parts
        of together at most `most` [s], evenly spread."""
        step = float(np.median(np.diff(self.time[self.clips[0]])))
        frames = max(round(seconds / step), SMOOTHED)
        parts = [
            part
            for clip in self.clips
            for part in np.array_split(clip, max(1, round(len(clip) / frames)))
        ]
        observed = begun_smoothly(self.time, self.observed, self.clips, parts)
        parts = [part for part in parts if np.isfinite(observed[part[:2]]).all()]
        few = np.linspace(0, len(parts) - 1, int(min(len(parts), max(1, most / seconds))))
        parts = [parts[k] for k in few.round().astype(int)]
        return replace(self, clips=parts, observed=observed, mesh_error=None)

    def folds(self, frames: int, count: int) -> np.ndarray:
        """Return whole clips in one fold, or parts of them where there are fewer clips."""
        fold, parts = np.zeros(frames, dtype=np.int64), -(-count // len(self.clips))
        for number, clip in enumerate(self.clips):
            part = np.arange(len(clip)) * parts // len(clip)
            fold[clip] = (number * parts + part) * count // (len(self.clips) * parts)
        return fold

    def _first(self, setup: Setup, rope: Moving) -> FirstStates:
        both = np.array([clip[:2] for clip in self.clips])
        drive = Drive(self.time[both], setup.ends[both], setup.clamp[both])
        return first_states(rope, drive, self.observed[both], self.every, float(self.base.weight))

    def _run(self, setup: Setup, rope: Moving, clip: np.ndarray, first: Start) -> Run:
        """Simulate one clip, with more steps if it needs them."""
        time = self.time[clip]
        drive = Drive(time[None], setup.ends[clip][None], setup.clamp[clip][None])
        step = np.quantile(np.diff(time), 0.5, method="lower")
        least = math.ceil(step / LONGEST_STEP - SAME_STEP)
        for fine in (self.finer * max(least, 1) * more for more in FINER):
            refined = refine(drive, fine)
            found = solve(rope, refined, first)
            if found.converged[0]:
                break
        return Run(refined, found, fine)


def _each(work: Callable[[int], Done], clips: range) -> list[Done]:
    """Work on each clip, as many at once as there are threads: compiled code releases the lock."""
    with ThreadPoolExecutor(threads()) as pool:
        return list(pool.map(work, clips))


def rope_of(setup: Setup) -> Moving:
    """Return the rope of a setup in motion."""
    p = setup.properties
    return moving(
        p, setup.rod(), setup.damping or undamped(p), setup.mass, setup.drag, setup.springs,
        setup.bodies,
    )  # fmt: skip


def fields_of(rope: Moving) -> dict[str, np.ndarray]:
    """Return the rope's fields by name, those of `MOVING_ROD`."""
    every = rope.rod._asdict() | rope._asdict()
    return {name: every[name] for name in names(MOVING_ROD)}


def refine(drive: Drive, fine: int) -> Drive:
    """Return the drive of one clip with `fine` steps for each of its own."""
    if fine == 1:
        return drive
    time = drive.time[0]
    ends = finer(time, drive.ends[0], fine)
    clamp = finer(time, drive.clamp[0], fine)
    clamp /= np.linalg.norm(clamp, axis=-1, keepdims=True)
    return Drive(_between(time, fine)[None], ends[None], clamp[None])


def finer(time: np.ndarray, values: np.ndarray, fine: int, axis: int = 0) -> np.ndarray:
    """Return values at time (T,) on a spline through them, `fine` for each interval. What is NaN
    at some time is so at all."""
    if fine == 1:
        return values
    known = np.isfinite(values).all(axis=axis, keepdims=True)
    curve = CubicSpline(time, np.nan_to_num(values), axis=axis)(_between(time, fine))
    return np.where(known, curve, np.nan)


def _between(time: np.ndarray, fine: int) -> np.ndarray:
    places = np.arange((len(time) - 1) * fine + 1) / fine
    return np.interp(places, np.arange(len(time)), time)
