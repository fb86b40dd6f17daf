"""The rope in equilibrium as a function in torch, to be differentiated like any other.

>>> import torch, ropefit
>>> EI = torch.tensor(2e-4, dtype=torch.float64, requires_grad=True)
>>> rope = ropefit.Rope(length=1.0, mass=0.05, EI=EI, segments=30)
>>> ends = torch.tensor([[[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]]], dtype=torch.float64)
>>> shape = rope(ends)                                    # (1, 31, 3) m
>>> shape[0, :, 2].min().backward()                       # how deep it hangs, by EI
>>> bool(EI.grad > 0)                                     # a stiffer rope hangs less deep
True
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ropefit.artifacts import FittedModel, Model, Observations
from ropefit.errors import NotConverged, WrongUsage
from ropefit.rod.rod import Properties, build
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.differentiable import settle
from ropefit.solvers.status import Status

Value = float | Tensor


@dataclass
class Rope:
    """A rope of `segments` segments; calling it gives its shape at rest.

    length [m] and mass [kg] of the whole rope; EI, GJ [N m²]; EA [N] (infinite: it does not
    stretch), GJ 2/3 EI where not given. Numbers, or float64 tensors, which may require gradients
    and spread over (frames, segments): (segments,) along the rope, (frames, 1) for a rope a frame.
    curvature (..., 3) [1/m] of the rest shape about the first and second director, and its twist,
    likewise. gravity (3,) [m/s²].
    """

    length: Value
    mass: Value
    EI: Value
    GJ: Value | None = None
    EA: Value = math.inf
    curvature: Tensor | tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: Tensor | tuple[float, float, float] = (0.0, 0.0, -9.81)
    segments: int = 40

    def __post_init__(self) -> None:
        """Raise WrongUsage for what no rope is."""
        if self.segments < 2:
            raise WrongUsage(f"segments={self.segments}: a rope has two or more")
        for name in ("length", "mass", "EI", "GJ", "EA"):
            given = getattr(self, name)
            if given is None:
                continue
            value = _plain(given).detach()
            positive = (value > 0) & (torch.isfinite(value) | (name == "EA"))
            if not positive.all():
                bad = value[~positive].flatten()[0]
                raise WrongUsage(f"{name}={float(bad):g}: must be positive and finite")

    @classmethod
    def of(cls, observations: Observations, model: Model, segments: int | None = None) -> Rope:
        """Return the rope that was identified, from the first parameter set of a fitted model.

        Where its mass is not known it is one kilogram a metre, and so are its rigidities: shapes
        are the same. Raises WrongUsage for models of the paper's solvers.
        """
        nominal: FittedModel = model.nominal
        if nominal.balance is None:
            raise WrongUsage(f"a model of {nominal.solver} has weights, no rigidities: fit again")
        found = {key: p.value for key, p in next(iter(nominal.groups.values())).parameters.items()}
        length = found.pop("length")
        density = observations.mass / observations.length if observations.mass else 1.0
        factor = 1.0 if nominal.balance.mass_known else float(np.linalg.norm(observations.gravity))
        return cls(
            length=length,
            mass=density * length,
            EI=factor * found["EI"],
            GJ=factor * found["GJ"],
            EA=factor * found.get("EA", math.inf),
            gravity=torch.tensor(observations.gravity),
            segments=segments or nominal.balance.segments,
        )

    def __call__(self, ends: Tensor, clamps: Tensor | None = None, throw: bool = True) -> Tensor:
        """Return (frames, segments + 1, 3) [m]: where the nodes come to rest, from end 0 to end 1.

        ends (frames, 2, 3) [m], NaN for an end that is free; clamps (frames, 2, 4): quaternions
        w x y z whose third axis is the rope's tangent, NaN (or None) for an end that may turn. An
        end is clamped in all frames or in none. Gradients reach ends, clamps and every tensor of
        the rope. Raises NotConverged, or with throw=False gives NaN for the frames that find no
        equilibrium.
        """
        ends = _plain(ends)
        if clamps is not None:
            clamps = _plain(clamps)
        if ends.ndim != 3 or ends.shape[1:] != (2, 3):
            raise WrongUsage(f"ends {tuple(ends.shape)}: expected (frames, 2, 3)")
        if torch.isnan(ends).all(-1).all(-1).any():
            raise WrongUsage("ends: no end is held; nothing says where the rope hangs")
        if clamps is None:
            clamps = torch.full((len(ends), 2, 4), torch.nan, dtype=torch.float64)
        held = ~torch.isnan(clamps).any(-1)
        if not (held == held[0]).all():
            raise WrongUsage("clamps: an end is clamped in all frames or in none")
        rod = build(
            self._properties(len(ends)),
            _plain(self.gravity),
            (bool(held[0, 0]), bool(held[0, 1])),
        )
        state, solution = settle(rod, Conditions(ends, clamps))
        if throw and not solution.converged.all():
            bad = np.flatnonzero(~solution.converged)
            why = Status(int(solution.status[bad[0]])).advice
            raise NotConverged(f"frame {bad[0]} ({len(bad)} of {len(ends)} fail): {why}")
        return state.x

    def _properties(self, frames: int) -> Properties:
        bend = torch.as_tensor(self.EI, dtype=torch.float64)
        twist = 2 / 3 * bend if self.GJ is None else self.GJ
        values = [
            torch.as_tensor(v, dtype=torch.float64)
            for v in (self.length / self.segments, self.EA, bend, twist, self.mass)
        ]
        rest = _plain(self.curvature)
        try:
            shape = torch.broadcast_shapes(
                *(v.shape for v in values), rest.shape[:-1], (self.segments,)
            )
            if len(shape) > 2 or (len(shape) == 2 and shape[0] not in (1, frames)):
                raise RuntimeError
        except RuntimeError:
            shapes = ", ".join(str(tuple(v.shape)) for v in [*values[1:], rest])
            raise WrongUsage(
                f"EA, EI, GJ, mass, curvature of shapes {shapes} do not spread over "
                f"({frames} frames, {self.segments} segments)"
            )
        length, axial, bend, twist, mass = (v.expand(shape) for v in values)
        return Properties(
            length, axial, axial, bend, twist, mass / self.length, rest.expand(*shape, 3)
        )


def _plain(value: Any) -> Tensor:
    """Return a float64 tensor of values, not of a transform: compiled code cannot look into those.

    Raises WrongUsage under torch.func's vmap, jacrev, grad and their like.
    """
    if isinstance(value, Tensor) and torch._C._functorch.is_functorch_wrapped_tensor(value):  # type: ignore[attr-defined]
        raise WrongUsage(
            "torch.func (vmap, jacrev, grad, ...) does not reach into the rope, which compiled "
            "code solves: give many ropes as frames of one call; for Jacobians use "
            "torch.autograd.functional.jacobian"
        )
    return torch.as_tensor(value, dtype=torch.float64)
