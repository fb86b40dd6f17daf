"""A rope that is free between its grips only, with the face of one that is free from end to end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.rod.quaternion import conjugate_product, multiply, rotate
from ropefit.solvers.xpbd.reference import State

UNTURNED = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)


@dataclass(frozen=True)
class GrippedRope:
    """F frames of a rope whose grips hold more than its ends: straight there, and as they turn.

    inner: the free part, which reports every node of its rod; outer (F, 2, 3) [m]: from each end of
    the rope to where it is free; mixed (K, N+3): what is reported of end, nodes and other end;
    of (K-1,): the segment of the rod in each reported one.
    """

    inner: EquilibriumRope
    outer: np.ndarray
    mixed: np.ndarray
    of: np.ndarray

    step: ClassVar[float] = EquilibriumRope.step
    advice: ClassVar[str] = EquilibriumRope.advice

    @property
    def device(self) -> torch.device | None:
        return self.inner.device

    @property
    def control_node(self) -> int:
        return 0 if self.inner.control_node == 0 else len(self.mixed) - 1

    @property
    def finest(self) -> GrippedRope:
        """Return the rope that reports its ends and every node of its rod."""
        nodes = self.mixed.shape[1]
        every = np.clip(np.arange(nodes - 1) - 1, 0, nodes - 4)
        return replace(self, mixed=np.eye(nodes), of=every)

    @property
    def start(self) -> State:
        """Return where the recording has the rope's ends, and the first frame."""
        first = self.inner.start
        state = self._reported(first, torch.from_numpy(self.outer))
        state.q[:, 0] = first.q[:, 0]
        return state

    def frames(self, index: np.ndarray) -> GrippedRope:
        """Return the same rope in some of its frames."""
        return replace(self, inner=self.inner.frames(index), outer=self.outer[index])

    def settle(
        self, values: Tensor, move: Tensor | None = None, frame: Tensor | None = None
    ) -> State:
        """Return equilibria, see `EquilibriumRope`; where a grip turns, what it holds turns along.

        move (..., F, 3) [m] of the rope's end; frame (..., F, 4) of the clamp there.
        """
        end, outer = (0 if self.inner.control_node == 0 else 1), torch.from_numpy(self.outer)
        if frame is not None:
            clamp = torch.from_numpy(self.inner.setup.clamp[:, end])
            back = conjugate_product(clamp, UNTURNED)
            arm = rotate(multiply(frame, back), outer[:, end])
            shift = arm - outer[:, end]
            other = outer[:, 1 - end].expand_as(arm)
            outer = torch.stack([arm, other] if end == 0 else [other, arm], dim=-2)
            move = shift if move is None else move + shift
        return self._reported(self.inner.settle(values, move, frame), outer)

    def _reported(self, state: State, outer: Tensor) -> State:
        first = state.x[..., :1, :] - outer[..., :1, :]
        last = state.x[..., -1:, :] - outer[..., 1:, :]
        whole = torch.cat([first, state.x, last], dim=-2)
        return State(torch.from_numpy(self.mixed) @ whole, state.q[..., self.of, :])


def gripped(nodes: np.ndarray, arc: np.ndarray) -> np.ndarray:
    """Return (K, N+3) what is reported at arc lengths (K,) [m], of the rope's end, the rod's nodes
    at (N+1,) [m], and the other end: a spline between the nodes, straight lines beyond them."""
    count = len(nodes)
    out = np.zeros((len(arc), count + 2))
    inside = (arc >= nodes[0]) & (arc <= nodes[-1])
    out[inside, 1:-1] = CubicSpline(nodes, np.eye(count), axis=0)(arc[inside])
    for end, outside in ((0, arc < nodes[0]), (-1, arc > nodes[-1])):
        share = np.abs(arc[outside] - nodes[end]) / abs(arc[end] - nodes[end])
        out[outside, end] = share
        out[outside, end + (1 if end == 0 else -1)] = 1 - share
    return out
