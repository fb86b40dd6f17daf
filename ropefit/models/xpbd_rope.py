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

from ropefit.models.weights import eta_names
from ropefit.rod.quaternion import director
from ropefit.rod.setup import Setup
from ropefit.rod.strains import Rest
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import COMPILED, simulate_compiled
from ropefit.solvers.xpbd.reference import Eta, Settings, State, distance_solver, simulate

SAMPLES = 12  # steps at which the constraints are looked at
CHUNK = 500  # frames simulated at once: bounds memory on long recordings


class Algorithm(NamedTuple):
    """How Algorithm 1 is run: the distance solver by its name, steps and iterations; which particle
    the gripper holds, and whether gravity has a weight on each side of it."""

    solver: str
    settings: Settings
    control_node: int = 0
    two_sided: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of its weights."""
        return eta_names(self.two_sided)


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

    step: ClassVar[float] = 1e-6  # of central differences: near divergence the answer is curved
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

    def frames(self, index: Tensor) -> XpbdRope:
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

    def settle_all(self, values: Tensor) -> State:
        """Run Algorithm 1 in every frame, values (F, n), without gradients and in bounded
        memory."""
        parts = []
        with torch.no_grad():
            for index in torch.split(torch.arange(len(values)), CHUNK):
                parts.append(self.frames(index).settle(values[index]))
        return State(torch.cat([s.x for s in parts]), torch.cat([s.q for s in parts]))

    def convergence(self, values: Tensor, final: Tensor) -> Convergence:
        """Return how the constraints stand along the iterations that lead to `final` (F, K, 3).

        The run is stopped within its first step and then after some of the steps, and once carried
        on with twice as many iterations.
        """
        whole, length = self.algorithm.settings, self.rest.length
        inner = np.unique(np.geomspace(1, whole.iterations, 6).round().astype(int))
        outer = np.unique(np.geomspace(1, whole.steps, SAMPLES).round().astype(int))[1:]
        stops = [replace(whole, steps=1, iterations=int(n)) for n in inner]
        stops += [replace(whole, steps=int(n)) for n in outer]
        violation, error = [], []
        for stop in stops:
            x = final if stop == whole else self._under(stop).settle_all(values).x
            now = (x[:, 1:] - x[:, :-1]).norm(dim=-1)
            violation.append((now - length).abs().amax(-1))
            error.append(now.sum(-1) / length.sum() - 1)
        twice = replace(whole, iterations=2 * whole.iterations)
        longer = self._under(twice).settle_all(values).x
        drift = (longer - final).norm(dim=-1).amax(-1) / length.sum()
        return Convergence(
            np.array([stop.total for stop in stops]),
            torch.stack(violation, 1).numpy(),
            torch.stack(error, 1).numpy(),
            drift.nan_to_num(torch.inf).clamp(max=1e3).numpy(),
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
    ends, clamp, gravity = setup.ends.numpy(), setup.clamp, setup.gravity.numpy()
    nodes, length = setup.segments + 1, float(setup.properties.length.sum())
    node = algorithm.control_node
    held_end = np.asarray(np.isfinite(ends[:, :, 0]).all(axis=0))
    clamped = torch.isfinite(clamp[:, :, 0]).all(dim=0)
    held = {0: held_end[0], nodes - 1: held_end[1], node: True}
    held_nodes = tuple(sorted(node for node, is_held in held.items() if is_held))
    mask = torch.zeros(nodes, dtype=torch.bool)
    mask[list(held_nodes)] = True
    mask_q = torch.zeros(nodes - 1, dtype=torch.bool)
    mask_q[0], mask_q[-1] = bool(clamped[0]) or hold_frame, bool(clamped[1])

    x = np.empty((len(ends), nodes, 3))
    tangents = director(clamp).numpy()
    for t in range(len(ends)):
        if 0 < node < nodes - 1:
            assert control_position is not None
            x[t] = _two_sides(length, nodes, gravity, ends[t], node, control_position[t])
        else:
            x[t] = hanging_shape(length, nodes, gravity, ends[t], tangents[t])
    positions = torch.from_numpy(x)
    others = [other for other in held_nodes if other != node]
    knots = sorted([(node, 1.0), *((other, 0.0) for other in others)])
    spread = np.interp(np.arange(nodes), [k for k, _ in knots], [v for _, v in knots])
    return XpbdRope(
        start=State(positions, frames_along(positions, clamp[:, 0], clamp[:, 1])),
        rest=_rest(setup),
        chain=Chain.build(mask, mask_q),
        spread=torch.from_numpy(spread)[:, None],
        gravity=setup.gravity,
        algorithm=algorithm,
        held_nodes=held_nodes,
    )


def _rest(setup: Setup) -> Rest:
    """Return the rest shape as Algorithm 1 takes it: whole quaternions at the inner nodes."""
    rod = setup.rod()
    vector = rod.rest[1:-1]
    real = torch.sqrt(1 - (vector * vector).sum(-1, keepdim=True))
    return Rest(rod.length, torch.cat([real, vector], dim=-1))


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
