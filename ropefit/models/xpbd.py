"""The paper's rope as one function of its unknowns: η, control point, orientation of the gripper.

A Rope holds what does not change during a fit (frames, rest shape, held particles, solver);
`settle` runs Algorithm 1 for any batch of unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.quaternion import director
from ropefit.rod.strains import Rest, straight_rest
from ropefit.solvers.equilibrium.start import frames_along, hanging_shape
from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.compiled import COMPILED, simulate_compiled
from ropefit.solvers.xpbd.reference import Eta, Settings, State, distance_solver, simulate

# Order of the six weights of Algorithm 1 in every parameter vector.
ETA = ("eta_x_G", "eta_x_D", "eta_x_S", "eta_q_S", "eta_q_B", "eta_SOR")


def eta_names(two_sided: bool) -> tuple[str, ...]:
    """Return the parameters: six, or seven when the two sides of the control point differ in
    gravity."""
    return ("eta_x_G_0", "eta_x_G_1", *ETA[1:]) if two_sided else ETA


@dataclass(frozen=True)
class Ends:
    """End poses of F frames: position (F, 2, 3) [m], orientation (F, 2, 4); NaN where not held."""

    position: np.ndarray
    orientation: np.ndarray

    def frames(self, index: np.ndarray) -> Ends:
        return Ends(self.position[index], self.orientation[index])


@dataclass(frozen=True)
class Rope:
    """F frames of one rope, ready to be simulated.

    start: x (F, K, 3), q (F, K-1, 4); spread (K, 1): how much each particle of the start follows a
    move of the control point (1 there, 0 at the other held particles, linear between).
    """

    start: State
    rest: Rest
    chain: Chain
    spread: Tensor
    gravity: Tensor
    solver: str
    settings: Settings
    control_node: int
    held_nodes: tuple[int, ...]
    two_sided: bool

    device: ClassVar[None] = None  # Algorithm 1 is compiled for the CPU
    step: ClassVar[float] = 1e-6  # of central differences: near divergence the answer is curved

    @property
    def names(self) -> tuple[str, ...]:
        return eta_names(self.two_sided)

    def frames(self, index: Tensor) -> Rope:
        """Return the same rope in some of its frames."""
        return replace(self, start=State(self.start.x[index], self.start.q[index]))

    def settle(
        self,
        eta: Tensor,
        move: Tensor | None = None,
        frame: Tensor | None = None,
    ) -> State:
        """Run Algorithm 1. eta (..., F, n) in the order of `names`, broadcast over frames.

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
        shape = np.broadcast_shapes(eta.shape[:-1], x.shape[:-2], q.shape[:-2])
        start, solver = (
            State(x.expand(*shape, -1, -1), q.expand(*shape, -1, -1)),
            distance_solver(self.solver),
        )
        algorithm = simulate_compiled if self.solver in COMPILED else simulate
        return algorithm(
            start, self.rest, self.chain, self._eta(eta), solver, self.gravity, self.settings
        )

    def _eta(self, eta: Tensor) -> Eta:
        columns = [eta[..., i, None, None] for i in range(eta.shape[-1])]
        if not self.two_sided:
            return Eta(*columns)
        side = torch.arange(self.spread.shape[0])[:, None] <= self.control_node
        return Eta(torch.where(side, columns[0], columns[1]), *columns[2:])


def build_rope(
    *,
    length: float,
    nodes: int,
    gravity: np.ndarray,
    ends: Ends,
    solver: str,
    settings: Settings,
    control_node: int = 0,
    control_position: np.ndarray | None = None,
    hold_frame: bool = False,
    two_sided: bool = False,
) -> Rope:
    """Return a rope with its ends (and control point) held where the frames have them.

    length [m]; gravity (3,) [m/s²]; control_position (F, 3) [m] is needed when the control point
    is not an end. hold_frame: hold the first segment's frame although end 0 is not clamped (its
    orientation is then an unknown).
    """
    inner = 0 < control_node < nodes - 1
    held_end = np.asarray(np.isfinite(ends.position[:, :, 0]).all(axis=0))
    clamped = np.asarray(np.isfinite(ends.orientation[:, :, 0]).all(axis=0))
    held = {0: held_end[0], nodes - 1: held_end[1], control_node: True}
    held_nodes = tuple(sorted(node for node, is_held in held.items() if is_held))
    mask = torch.zeros(nodes, dtype=torch.bool)
    mask[list(held_nodes)] = True
    mask_q = torch.zeros(nodes - 1, dtype=torch.bool)
    mask_q[0], mask_q[-1] = bool(clamped[0]) or hold_frame, bool(clamped[1])

    frames = len(ends.position)
    x = np.empty((frames, nodes, 3))
    tangents = director(torch.from_numpy(ends.orientation)).numpy()
    for t in range(frames):
        if inner:
            assert control_position is not None
            x[t] = _two_sides(
                length, nodes, gravity, ends.position[t], control_node, control_position[t]
            )
        else:
            x[t] = hanging_shape(length, nodes, gravity, ends.position[t], tangents[t])
    positions = torch.from_numpy(x)
    orientation = torch.from_numpy(ends.orientation)
    q = frames_along(positions, orientation[:, 0], orientation[:, 1])
    others = [node for node in held_nodes if node != control_node]
    knots = sorted([(control_node, 1.0), *((node, 0.0) for node in others)])
    spread = np.interp(np.arange(nodes), [k for k, _ in knots], [v for _, v in knots])
    return Rope(
        start=State(positions, q),
        rest=straight_rest(length, nodes),
        chain=Chain.build(mask, mask_q),
        spread=torch.from_numpy(spread)[:, None],
        gravity=torch.tensor(gravity, dtype=torch.float64),
        solver=solver,
        settings=settings,
        control_node=control_node,
        held_nodes=held_nodes,
        two_sided=two_sided,
    )


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
