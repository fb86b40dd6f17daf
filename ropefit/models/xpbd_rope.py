"""The paper's rope with the face of every rope that a loss is minimised of: weights in, states out.

An XpbdRope holds what does not change during a fit (frames, rest shape, held particles, solver);
`settle` runs Algorithm 1 for any batch of weights, control points and orientations of the gripper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.models.algorithm import STEP, Algorithm
from ropefit.rod.quaternion import director
from ropefit.rod.setup import Setup
from ropefit.rod.strains import Rest
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape
from ropefit.solvers.rods import whole_rest
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import simulate_compiled
from ropefit.solvers.xpbd.loops import COMPILED
from ropefit.solvers.xpbd.reference import Eta, State, distance_solver, simulate
from ropefit.solvers.xpbd.settings import Settings

SAMPLES = 12  # steps at which the constraints are looked at
CHUNK = 500  # frames simulated at once: bounds memory on long recordings


class Convergence(NamedTuple):
    """Along S sampled iterations: |C^D| max (F, S) [m], relative length error (F, S).

    drift (F,): largest move of a particle, over the rope's length, if iterated twice as long.
    """

    iteration: np.ndarray
    distance_violation: np.ndarray
    length_error: np.ndarray
    drift: np.ndarray


@dataclass(frozen=True)
class XpbdRope:
    """F frames of one rope, ready to be simulated.

    start: x (F, K, 3), q (F, K-1, 4); spread (K, 1): how much each particle of the start follows a
    move of the control point (1 there, 0 at the other held particles, linear between).
    """

    start: State
    rest: Rest
    chain: Chain
    spread: Tensor
    gravity: Tensor
    algorithm: Algorithm
    held_nodes: tuple[int, ...]

    step: ClassVar[float] = STEP
    advice: ClassVar[str] = "identify with smaller weights"

    @property
    def control_node(self) -> int:
        return self.algorithm.control_node

    @property
    def device(self) -> None:
        """Return none: Algorithm 1 is compiled for the CPU."""

    @property
    def finest(self) -> XpbdRope:
        """Return itself: it has no other nodes than those that it reports."""
        return self

    def frames(self, index: np.ndarray) -> XpbdRope:
        """Return the same rope in some of its frames."""
        return replace(self, start=State(self.start.x[index], self.start.q[index]))

    def settle(
        self, values: Tensor, move: Tensor | None = None, frame: Tensor | None = None
    ) -> State:
        """Run Algorithm 1. values (..., F, n): weights in the order of `Algorithm.names`.

        move (..., F, 3) [m]: of the control point from where the start has it. frame (..., F, 4):
        held frame of the first segment, instead of the start's.
        """
        x, q = self.start
        if move is not None:
            x = x + move[..., None, :] * self.spread
        if frame is not None:
            first = torch.zeros(q.shape[-2], 1, dtype=torch.bool)
            first[0] = True
            q = torch.where(first, frame[..., None, :], q)
        shape = np.broadcast_shapes(values.shape[:-1], x.shape[:-2], q.shape[:-2])
        start = State(x.expand(*shape, -1, -1), q.expand(*shape, -1, -1))
        name, settings = self.algorithm.solver, self.algorithm.settings
        run = simulate_compiled if name in COMPILED else simulate
        return run(
            start, self.rest, self.chain, self._eta(values), distance_solver(name), self.gravity,
            settings,
        )  # fmt: skip

    def settle_all(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Run Algorithm 1 in every frame, values (F, n), in bounded memory: x (F, K, 3) [m] and
        q (F, K-1, 4)."""
        x, q = (np.empty(item.shape) for item in self.start)
        with torch.no_grad():
            for first in range(0, len(values), CHUNK):
                part = np.arange(first, min(first + CHUNK, len(values)))
                state = self.frames(part).settle(torch.tensor(values[part]))
                x[part], q[part] = state.x, state.q
        return x, q

    def convergence(self, values: np.ndarray, final: np.ndarray) -> Convergence:
        """Return how the constraints stand along the iterations that lead to `final` (F, K, 3).

        The run is stopped within its first step and then after some of the steps, and once carried
        on with twice as many iterations.
        """
        whole, length = self.algorithm.settings, self.rest.length.numpy()
        inner = np.unique(np.geomspace(1, whole.iterations, 6).round().astype(int))
        outer = np.unique(np.geomspace(1, whole.steps, SAMPLES).round().astype(int))[1:]
        stops = [replace(whole, steps=1, iterations=int(n)) for n in inner]
        stops += [replace(whole, steps=int(n)) for n in outer]
        violation, error = [], []
        for stop in stops:
            x = final if stop == whole else self._under(stop).settle_all(values)[0]
            now = np.linalg.norm(np.diff(x, axis=1), axis=-1)
            violation.append(np.abs(now - length).max(-1))
            error.append(now.sum(-1) / length.sum() - 1)
        twice = replace(whole, iterations=2 * whole.iterations)
        longer, _ = self._under(twice).settle_all(values)
        with np.errstate(over="ignore"):  # it may diverge
            drift = np.linalg.norm(longer - final, axis=-1).max(-1) / length.sum()
        return Convergence(
            np.array([stop.total for stop in stops]),
            np.stack(violation, 1),
            np.stack(error, 1),
            np.minimum(np.nan_to_num(drift, nan=np.inf), 1e3),
        )

    def _under(self, settings: Settings) -> XpbdRope:
        return replace(self, algorithm=self.algorithm._replace(settings=settings))

    def _eta(self, values: Tensor) -> Eta:
        columns = [values[..., i, None, None] for i in range(values.shape[-1])]
        if not self.algorithm.two_sided:
            return Eta(*columns)
        side = torch.arange(self.spread.shape[0])[:, None] <= self.control_node
        return Eta(torch.where(side, columns[0], columns[1]), *columns[2:])


def build_rope(
    setup: Setup,
    algorithm: Algorithm,
    control_position: np.ndarray | None = None,
    hold_frame: bool = False,
) -> XpbdRope:
    """Return a setup's rope with its ends (and control point) held where the frames have them.

    control_position (F, 3) [m] is needed when the control point is not an end. hold_frame: hold the
    first segment's frame although end 0 is not clamped (its orientation is then an unknown).
    Of the setup count rest shape, ends, clamps and gravity: Algorithm 1 knows no rigidity and no
    force in newtons.
    """
    ends, clamp, gravity = setup.ends, setup.clamp, setup.gravity
    nodes, length = setup.segments + 1, float(setup.properties.length.sum())
    node = algorithm.control_node
    held_end = np.asarray(np.isfinite(ends[:, :, 0]).all(axis=0))
    clamped = np.asarray(np.isfinite(clamp[:, :, 0]).all(axis=0))
    held = {0: held_end[0], nodes - 1: held_end[1], node: True}
    held_nodes = tuple(sorted(node for node, is_held in held.items() if is_held))
    mask = torch.zeros(nodes, dtype=torch.bool)
    mask[list(held_nodes)] = True
    mask_q = torch.zeros(nodes - 1, dtype=torch.bool)
    mask_q[0], mask_q[-1] = bool(clamped[0]) or hold_frame, bool(clamped[1])

    x = np.empty((len(ends), nodes, 3))
    tangents = director(clamp)
    for t in range(len(ends)):
        if 0 < node < nodes - 1:
            assert control_position is not None
            x[t] = _two_sides(length, nodes, gravity, ends[t], node, control_position[t])
        else:
            x[t] = hanging_shape(length, nodes, gravity, ends[t], tangents[t])
    q = frames_along(x, clamp[:, 0], clamp[:, 1])
    others = [other for other in held_nodes if other != node]
    knots = sorted([(node, 1.0), *((other, 0.0) for other in others)])
    spread = np.interp(np.arange(nodes), [k for k, _ in knots], [v for _, v in knots])
    return XpbdRope(
        start=State(torch.from_numpy(x), torch.from_numpy(q)),
        rest=_rest(setup),
        chain=Chain.build(mask, mask_q),
        spread=torch.from_numpy(spread)[:, None],
        gravity=torch.tensor(gravity),
        algorithm=algorithm,
        held_nodes=held_nodes,
    )


def _rest(setup: Setup) -> Rest:
    """Return the rest shape as Algorithm 1 takes it: whole quaternions at the inner nodes."""
    rod = setup.rod()
    return Rest(torch.tensor(rod.length), torch.from_numpy(whole_rest(rod.rest[1:-1])))


def _two_sides(
    length: float,
    nodes: int,
    gravity: np.ndarray,
    ends: np.ndarray,
    node: int,
    position: np.ndarray,
) -> np.ndarray:
    """Return (K, 3) start of a rope held at an inner particle: a hanging shape on each side."""
    free = np.full((2, 3), np.nan)
    segment = length / (nodes - 1)
    first = hanging_shape(segment * node, node + 1, gravity, np.stack([ends[0], position]), free)
    second = hanging_shape(
        segment * (nodes - 1 - node), nodes - node, gravity, np.stack([position, ends[1]]), free
    )
    return np.concatenate([first, second[1:]])
