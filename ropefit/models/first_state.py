"""The state from which a clip is simulated, from its first two frames observed, and its derivative.

Each of the two is the equilibrium of the rope that springs pull to what was observed, with the
nodes that are inside a body on its surface: a step that had to push them out would throw them. The
speed is the one from which the rope, in one step, gets from the first to the second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.rod.bodies import change_pushed_out, pushed_out
from ropefit.rod.fields import ROD, names
from ropefit.rod.moving import Moving
from ropefit.solvers.dynamics.derivatives import Directions, tangent
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve
from ropefit.solvers.equilibrium import implicit
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution
from ropefit.solvers.equilibrium.solve import solve as settle

SPRING = 2e-4  # m per weight of the rope: compliance of what pulls the first states to the data
AT_REST = frozenset(names(ROD))
SMOOTHED = 9  # frames whose parabola gives the first two: noise there is a wrong first speed
CORRECTIONS = 3  # of the first speed, by where one step with it leads


@dataclass(frozen=True)
class FirstStates:
    """The first states of C clips, and how they came about: the bodies that are touched, the two
    equilibria of each clip, and the first step with every speed that was tried."""

    start: Start
    bodies: np.ndarray
    equilibria: tuple[Solution, Solution]
    steps: list[Trajectory]
    time_step: np.ndarray

    def respond(
        self, rod: dict[str, np.ndarray], ends: np.ndarray, clamp: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return derivatives of the clips' first states in P directions: x0 (C, P, N+1, 3), v0
        likewise, and the turns of q0 (C, P, N, 3).

        rod: fields of `MOVING_ROD` (1, P, ...); ends, clamp (C, P, 2, 2, 3) at the first two times.
        """
        statics = {name: rod[name] for name in rod if name in AT_REST}
        (x0, turn), (x1, _) = (
            implicit.tangent(
                s, implicit.Directions(**statics, ends=ends[:, :, t], clamp=clamp[:, :, t])
            )
            for t, s in enumerate(self.equilibria)
        )
        if self.bodies.any():
            x0, x1 = (
                change_pushed_out(self.bodies, s.x, rod["bodies"], dx)
                for s, dx in zip(self.equilibria, (x0, x1), strict=True)
            )
        dt = self.time_step[:, None, None, None]
        v0 = (x1 - x0) / dt
        for step in self.steps:
            moved = Directions(**rod, ends=ends, clamp=clamp, x0=x0, v0=v0, q0=turn)
            v0 = v0 + np.nan_to_num(x1 - tangent(step, moved)[:, :, 1]) / dt
        return x0, v0, turn


def first_states(
    rope: Moving, drive: Drive, observed: np.ndarray, every: int, weight: float
) -> FirstStates:
    """Return the first states of C clips.

    drive: of their first two times; observed (C, 2, K, 3) [m]: centrelines at every `every`-th
    node; weight [N] that the springs' stiffness is in proportion to.
    """
    clips, inner = len(observed), np.arange(1, observed.shape[2] - 1)
    node = np.repeat(inner * every, 3)
    across = np.broadcast_to(np.tile(np.eye(3), (len(inner), 1)), (clips, len(node), 3))
    states, last = [], None
    for t in (0, 1):
        seen = np.isfinite(observed[:, t, inner]).all(-1)
        pulled = Conditions(
            drive.ends[:, t],
            drive.clamp[:, t],
            node,
            across,
            np.nan_to_num(observed[:, t, inner]).reshape(clips, -1),
            np.full((clips, len(node)), SPRING / weight),
            np.repeat(seen, 3, axis=1),
        )
        last = settle(rope.rod, pulled, last)
        states.append(last)
    bodies, q0 = rope.bodies, states[0].q
    x0, x1 = (pushed_out(bodies, state.x) for state in states)
    step = drive.time[:, 1] - drive.time[:, 0]
    v, tried = (x1 - x0) / step[:, None, None], []
    for _ in range(CORRECTIONS):
        tried.append(solve(rope, drive, Start(x0, q0, v)))
        v = v + np.nan_to_num(x1 - tried[-1].x[:, 1]) / step[:, None, None]
    return FirstStates(Start(x0, q0, v), bodies, (states[0], states[1]), tried, step)


def begun_smoothly(
    time: np.ndarray, lines: np.ndarray, clips: list[np.ndarray], parts: list[np.ndarray]
) -> np.ndarray:
    """Return centrelines (F, K, 3) [m] with the first two of each part of a clip from a parabola in
    time through the frames of its clip around them; as they are, where some of these lack points.

    time (F,) [s]; clips and parts: frames that follow each other.
    """
    out, half = lines.copy(), SMOOTHED // 2
    clip_of = {int(f): clip for clip in clips for f in clip}
    for part in parts:
        clip = clip_of[int(part[0])]
        first = max(0, min(int(part[0] - clip[0]) - half, len(clip) - SMOOTHED))
        near = clip[first : first + SMOOTHED]
        if np.isfinite(lines[near]).all():
            powers = np.vander(time[near] - time[part[0]], 3)
            weights = powers[np.isin(near, part[:2])] @ np.linalg.pinv(powers)
            out[part[:2]] = np.einsum("bt,tka->bka", weights, lines[near])
    return out
