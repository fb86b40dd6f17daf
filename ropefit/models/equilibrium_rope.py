"""The rope in equilibrium, with the face of the paper's rope: values in, states out, any loss.

The setup is of numpy; in torch it becomes what its values and moves make of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from ropefit.models.bends import axial_law_of, elements_of, joined
from ropefit.models.rope_values import NAMES
from ropefit.rod.rod import Properties, Rod
from ropefit.rod.sensor import SensorModel
from ropefit.rod.setup import Setup
from ropefit.solvers.batched.implicit import settled_batched
from ropefit.solvers.batched.solve import solve_batched
from ropefit.solvers.equilibrium.conditions import Conditions, FrictionElements
from ropefit.solvers.equilibrium.differentiable import settled
from ropefit.solvers.equilibrium.implicit import following
from ropefit.solvers.equilibrium.potentials import solve_with_potentials
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.solve import solve
from ropefit.solvers.xpbd.reference import State


@dataclass(frozen=True)
class EquilibriumRope:
    """F frames of a setup; nodes are every `every`-th node of its rod, as the sensor reports them.

    control_node: 0 or the last node, in observation nodes. tied: the twist rigidity follows the
    bending rigidity at their ratio in the setup, whatever its value. recorded (F, 2, 3) [m]: the
    ends as the recording tells them, where the setup has them corrected. near: states whose branch
    is followed; else the one that a catenary leads to. plain: the rope without effects, which the
    values describe, where the setup has effects. friction_elements: what each frame's past has left
    in a rope that remembers. device: where many ropes are settled at once; the compiled path, if
    not given. Compare `XpbdRope`.
    """

    setup: Setup
    every: int
    control_node: int
    tied: bool = False
    recorded: np.ndarray | None = None
    near: Solution | None = None
    plain: Properties | None = None
    device: torch.device | None = None
    friction_elements: FrictionElements | None = None

    step: ClassVar[float] = 1e-4  # of central differences: the answer is smooth
    advice: ClassVar[str] = "look at the ends and the length of the rope"

    @property
    def finest(self) -> EquilibriumRope:
        """Return the rope that reports every node of its rod."""
        return replace(self, every=1)

    @property
    def start(self) -> State:
        """Return where the recording has the control point, and the first frame, for searches that
        move them. What lies between is zero."""
        frames, nodes = len(self.setup.ends), self.setup.segments // self.every + 1
        ends = self._tensors.ends
        if self.recorded is not None:
            ends = torch.from_numpy(self.recorded)
        x = torch.zeros(frames, nodes, 3, dtype=torch.float64)
        x[:, 0], x[:, -1] = ends[:, 0], ends[:, 1]
        q = torch.zeros(frames, nodes - 1, 4, dtype=torch.float64)
        q[:, 0] = self._tensors.clamp[:, 0]
        return State(x, q)

    def frames(self, index: np.ndarray) -> EquilibriumRope:
        """Return the same rope in some of its frames."""
        setup = self.setup.frames(index)
        recorded = None if self.recorded is None else self.recorded[index]
        near = None if self.near is None else self.near.frames(index)
        past = None if self.friction_elements is None else self.friction_elements.frames(index)
        return replace(self, setup=setup, recorded=recorded, near=near, friction_elements=past)

    @cached_property
    def _tensors(self) -> Any:
        """Return the setup with tensors for what makes its rod, its ends and its sensor."""
        s = self.setup
        fields = ("gravity", "load", "mass", "moment", "clamp_compliance", "kinks", "stretch",
                  "ends", "clamp", "rigid")  # fmt: skip
        given = {name: getattr(s, name) for name in fields}
        return s._replace(
            properties=Properties(*map(_tensor, s.properties)),
            sensor=SensorModel(*map(_tensor, s.reported)),
            **{name: None if value is None else _tensor(value) for name, value in given.items()},
        )

    def holding_its_frame(self, values: Tensor) -> EquilibriumRope:
        """Return the rope whose end 0, if it is not clamped, holds the frame that it has of itself
        for values (F, 4)."""
        if self.setup.clamped[0]:
            return self
        with torch.no_grad():
            first = self.settle(values).q[:, 0]
        clamp = self.setup.clamp.copy()
        clamp[:, 0] = first.numpy()
        held = self.setup._replace(clamp=clamp, clamped=(True, self.setup.clamped[1]))
        return replace(self, setup=held)

    def settle(
        self, values: Tensor, move: Tensor | None = None, frame: Tensor | None = None
    ) -> State:
        """Return equilibria for values (..., F, 4) in the order of NAMES; NaN where none is
        reached.

        move (..., F, 3) [m] of the control point; frame (..., F, 4) of the first end's clamp.
        """
        s = self._tensors
        shapes = [values.shape[:-1], s.ends.shape[:1]]
        shapes += [item.shape[:-1] for item in (move, frame) if item is not None]
        shape = np.broadcast_shapes(*shapes)
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
        own = s.properties if self.plain is None else Properties(*map(_tensor, self.plain))
        ratio = flat[:, :1] / own.bend
        length = s.properties.length * (flat[:, 3:] / own.length.sum())
        twist = s.properties.twist * (ratio if self.tied else flat[:, 1:2] / own.twist)
        rows = rows._replace(
            bend=s.properties.bend * ratio,
            twist=twist,
            axial=flat[:, 2:3].expand(-1, s.segments),
            length=length,
        )
        # Loads of a frame's own, as of inertia.
        load = s.load.expand(*shape, *s.load.shape[-2:]).reshape(-1, *s.load.shape[-2:])
        rod, start = s._replace(properties=rows, load=load).rod(), None
        of = np.broadcast_to(np.arange(len(s.ends)), shape).reshape(-1)
        past = None if self.friction_elements is None else self.friction_elements.frames(of)
        law = elements_of(self.setup, rod.in_numpy(), len(flat))
        held = Conditions(
            ends, clamp, friction_elements=joined(past, law), axial=axial_law_of(self.setup)
        )
        if self.near is not None:
            start = self.near.frames(of)
        x, q = self._states(rod, held, start)
        per_row = {
            name: getattr(s.sensor, name).squeeze(-2).expand(*shape, 3).reshape(-1, 1, 3)
            for name in ("origin", "normal")
        }
        x = s.sensor._replace(**per_row)(x)
        nodes = s.segments // self.every + 1
        x = x[:, :: self.every].reshape(*shape, nodes, 3)
        q = q[:, self.every // 2 :: self.every].reshape(*shape, nodes - 1, 4)
        return State(x, q)

    def _states(self, rod: Rod, held: Conditions, start: States | None) -> State:
        """Return nodes and frames of every segment, on the CPU: from `start`, or else from
        catenaries."""
        device, potentials, followers = self.device, self.setup.potentials, self.setup.followers
        if (
            held.friction_elements is not None or held.axial is not None
        ):  # by the compiled path only, like all below
            device = None
        if potentials:  # contact and tethers: by the compiled path only
            return settled(solve_with_potentials(rod, held, potentials, start), rod, held)
        if followers:  # so are forces that turn with the rope

            def under(load: np.ndarray, near: States | None) -> Solution:
                own = rod.in_numpy().each(len(held.ends))
                more = own._replace(load=own.load + load) if load.size else own
                return solve(more, held, near)

            return settled(following(under, followers, start), rod, held)

        def found(start: States | None) -> Solution:
            if device is None:
                return solve(rod, held, start)
            return solve_batched(rod, held, device, start)

        solution = found(start)
        again = ~solution.converged
        if start is not None and again.any():
            solution.put(again, found(None), again)
        if device is None:
            return settled(solution, rod, held)
        return State(*(t.cpu() for t in settled_batched(solution, rod, held, device)))


def _tensor(value: np.ndarray | float) -> Tensor:
    return torch.from_numpy(np.array(value, dtype=np.float64))
