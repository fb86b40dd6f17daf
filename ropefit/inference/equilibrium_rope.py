"""The rope in equilibrium, with the face of the paper's rope: values in, states out, any loss."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ropefit.rod.rod import Properties
from ropefit.rod.setup import Setup
from ropefit.solvers.conditions import Conditions
from ropefit.solvers.implicit import settle
from ropefit.solvers.xpbd import State

NAMES = ("EI", "GJ", "EA", "length")
MEANING = {
    "EI": "bending rigidity",
    "GJ": "twist rigidity",
    "EA": "axial rigidity",
    "length": "rest length of the rope",
}


@dataclass(frozen=True)
class EquilibriumRope:
    """F frames of a setup; nodes are every `every`-th node of its rod.

    control_node: 0 or the last node, in observation nodes. Compare `inference.rope.Rope`.
    """

    setup: Setup
    every: int
    control_node: int

    @property
    def names(self) -> tuple[str, ...]:
        return NAMES

    @property
    def start(self) -> State:
        """Where the control point and the first frame are, for searches that move them."""
        frames, nodes = len(self.setup.ends), self.setup.segments // self.every + 1
        x = torch.zeros(frames, nodes, 3, dtype=torch.float64)
        x[:, 0], x[:, -1] = self.setup.ends[:, 0], self.setup.ends[:, 1]
        q = torch.zeros(frames, nodes - 1, 4, dtype=torch.float64)
        q[:, 0] = self.setup.clamp[:, 0]
        return State(x, q)

    def frames(self, index: Tensor) -> EquilibriumRope:
        """The same rope in some of its frames."""
        return replace(self, setup=self.setup.frames(index))

    def settle(
        self, values: Tensor, move: Tensor | None = None, frame: Tensor | None = None
    ) -> State:
        """Equilibria for values (..., F, 4) in the order of NAMES; NaN where none is reached.

        move (..., F, 3) [m] of the control point; frame (..., F, 4) of the first end's clamp.
        """
        s = self.setup
        shapes = [values.shape[:-1], s.ends.shape[:1]]
        shapes += [item.shape[:-1] for item in (move, frame) if item is not None]
        shape = torch.broadcast_shapes(*shapes)
        flat = values.expand(*shape, len(NAMES)).reshape(-1, len(NAMES))
        ends = s.ends.expand(*shape, 2, 3).reshape(-1, 2, 3)
        clamp = s.clamp.expand(*shape, 2, 4).reshape(-1, 2, 4)
        end = 0 if self.control_node == 0 else 1
        place = torch.zeros(2, 1, dtype=torch.bool)
        place[end] = True
        if move is not None:
            shift = move.expand(*shape, 3).reshape(-1, 1, 3)
            ends = torch.where(place, ends + shift, ends)
        if frame is not None:
            held = frame.expand(*shape, 4).reshape(-1, 1, 4)
            clamp = torch.where(place, held, clamp)
        rows = s.properties._replace(
            **{
                name: getattr(s.properties, name).expand(
                    len(flat), *getattr(s.properties, name).shape
                )
                for name in Properties._fields
            }
        )
        ratio = flat[:, :1] / s.properties.bend
        length = s.properties.length * (flat[:, 3:] / s.properties.length.sum())
        rows = rows._replace(
            bend=s.properties.bend * ratio,
            twist=flat[:, 1:2].expand(-1, s.segments),
            axial=flat[:, 2:3].expand(-1, s.segments),
            length=length,
        )
        state, _ = settle(s._replace(properties=rows).rod(), Conditions(ends, clamp))
        x, q = state
        nodes = s.segments // self.every + 1
        x = x[:, :: self.every].reshape(*shape, nodes, 3)
        q = q[:, self.every // 2 :: self.every].reshape(*shape, nodes - 1, 4)
        return State(x, q)


def ranges(setup: Setup) -> dict[str, tuple[float, float, float]]:
    """(start, lower, upper) in SI of every name."""
    p = setup.properties
    bend, length = float(p.bend[0]), float(p.length.sum())
    weight = float(p.density.mean() * setup.gravity.norm()) * length
    return {
        "EI": (bend, 1e-4 * bend, 1e4 * bend),
        "GJ": (float(p.twist[0]), 1e-4 * bend, 1e4 * bend),
        "EA": (float(p.axial[0]), 1.0 * weight, 1e7 * weight),
        "length": (length, 0.8 * length, 1.25 * length),
    }
