"""The discrete rod in SI units: rigidities, weight and rest shape on the paper's strains.

Its energy is quadratic in stretch-shear C^S and bend-twist C^B; XPBD with compliance
α = 1/(EA l) and l/(4 EI) has the same equilibrium.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ropefit.rod.fields import ROD


class Properties(NamedTuple):
    """What a rope is made of, segment by segment; every array may have more dimensions in front.

    length (N,) [m]; axial EA, shear GA [N]; bend EI, twist GJ [N m²]; density [kg/m];
    curvature (N, 3) [1/m]: of the rest shape, about the first and second director, and its twist.
    `math.inf` for EA and GA makes a rope that neither stretches nor shears.
    """

    length: Tensor
    axial: Tensor
    shear: Tensor
    bend: Tensor
    twist: Tensor
    density: Tensor
    curvature: Tensor


DIMS = tuple(len(field.shape) for field in ROD)  # without that of several ropes


class Rod(NamedTuple):
    """The discrete rod; N segments between N+1 nodes, with or without a dimension of R ropes.

    length (R, N) [m]; flexibility (R, N, 3) [1/N]: 1/GA, 1/GA, 1/EA; stiffness (R, N+1, 3) [N m]
    of C^B at each node (the first and last are those of clamps, zero without); rest (R, N+1, 3):
    vector part of the rest Darboux quaternion; load (R, N+1, 3) [N] on the nodes; moment (R, 2, 3)
    [N m] on the first and last segment, in space. See `fields.ROD`.
    """

    length: Tensor
    flexibility: Tensor
    stiffness: Tensor
    rest: Tensor
    load: Tensor
    moment: Tensor

    @property
    def arc(self) -> Tensor:
        """Return (R, N+1) [m] the rest arc length of the nodes."""
        return torch.nn.functional.pad(self.length.cumsum(-1), (1, 0))

    def each(self, frames: int) -> Rod:
        """Return the rod once for each of `frames`, also what was the same in all."""
        return Rod(
            *(
                t if t.ndim > d else t.expand(frames, *t.shape)
                for t, d in zip(self, DIMS, strict=True)
            )
        )

    def frames(self, index: np.ndarray) -> Rod:
        """Return the rod in some of the frames; what is the same in all stays as it is."""
        return Rod(
            *(t[index] if t.ndim > d and len(t) > 1 else t for t, d in zip(self, DIMS, strict=True))
        )


def uniform(
    *,
    length: float,
    segments: int,
    bend: Tensor | float,
    twist: Tensor | float | None = None,
    axial: Tensor | float = torch.inf,
    shear: Tensor | float | None = None,
    density: Tensor | float = 1.0,
    curvature: Tensor | tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Properties:
    """Return a rope that is the same everywhere, of numbers, or tensors (...,) for several ropes.

    Without a twist rigidity it is 2/3 of the bending rigidity (a round incompressible section);
    without a shear rigidity it is the axial one. length [m], the rest as in `Properties`.
    """
    bend = _tensor(bend)
    values = [
        _tensor(length / segments),
        _tensor(axial),
        _tensor(axial if shear is None else shear),
        bend,
        2 / 3 * bend if twist is None else _tensor(twist),
        _tensor(density),
    ]
    curvature = _tensor(curvature)
    shape = np.broadcast_shapes(*(v.shape for v in values), curvature.shape[:-1])
    spread = [v[..., None].expand(*shape, segments) for v in values]
    length_, axial_, shear_, bend_, twist_, density_ = spread
    rest = curvature.expand(*shape, 3)[..., None, :].expand(*shape, segments, 3)
    return Properties(length_, axial_, shear_, bend_, twist_, density_, rest)


def build(
    p: Properties,
    gravity: Float[Tensor, " 3"],
    clamped: tuple[bool, bool],
    clamp_compliance: Float[Tensor, "*batch 2 2"] | None = None,
    kinks: Float[Tensor, "*batch nodes 3"] | None = None,
) -> Rod:
    """Return the discrete rod of a rope under gravity (3,) [m/s²].

    A clamp holds a frame at the very end of the rope: half a segment lies between it and the first
    frame. clamp_compliance (..., 2, 2) [rad/(N m)]: how far the clamps themselves yield to
    bending and to twist, 0 if not given; infinity lets go. kinks (..., N+1, 3) [rad]: turns of the
    rest shape at the nodes, besides its curvature. Each segment's l/EI is shared by the two nodes
    beside it, so properties may jump.
    """
    half_bend, half_twist = 0.5 * p.length / p.bend, 0.5 * p.length / p.twist
    soft = at_nodes(half_bend)
    soft = torch.stack([soft, soft, at_nodes(half_twist)], dim=-1)
    if clamp_compliance is not None:
        soft = _with_clamp_compliance(soft, clamp_compliance)
    ends = torch.ones(soft.shape[-2], 1, dtype=soft.dtype, device=soft.device)
    ends[0], ends[-1] = float(clamped[0]), float(clamped[1])
    turn = at_nodes(0.5 * p.length[..., None] * p.curvature, -2)
    if kinks is not None:
        turn = turn + kinks
    mass = at_nodes(0.5 * p.density * p.length)
    load = mass[..., None] * gravity
    return Rod(
        length=p.length,
        flexibility=1 / torch.stack([p.shear, p.shear, p.axial], dim=-1),
        stiffness=4 / soft * ends,
        rest=half_turn(turn),
        load=load,
        moment=load.new_zeros(*load.shape[:-2], 2, 3),
    )


def half_turn(turn: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Return the vector part (..., 3) of the quaternion that turns by |turn| [rad] about turn."""
    square = (turn * turn).sum(-1, keepdim=True)
    half = torch.sqrt(square + 1e-30) / 2
    return turn * torch.sinc(half / torch.pi) / 2


def at_nodes(value: Tensor, dim: int = -1) -> Tensor:
    """Return the sum over the segments beside each node: (..., N) -> (..., N+1)."""
    zero = torch.zeros_like(value.narrow(dim, 0, 1))
    return torch.cat([value, zero], dim) + torch.cat([zero, value], dim)


def _with_clamp_compliance(soft: Tensor, clamp_compliance: Tensor) -> Tensor:
    """Return the compliances of the bends (..., N+1, 3) with those of the clamps at both ends."""
    bend, twist = clamp_compliance.unbind(-1)
    extra = torch.stack([bend, bend, twist], dim=-1)  # (..., 2, 3)
    shape = np.broadcast_shapes(soft.shape[:-2], extra.shape[:-2])
    soft, extra = soft.expand(*shape, *soft.shape[-2:]), extra.expand(*shape, 2, 3)
    first, last = soft[..., :1, :] + extra[..., :1, :], soft[..., -1:, :] + extra[..., 1:, :]
    return torch.cat([first, soft[..., 1:-1, :], last], dim=-2)


def _tensor(value: Tensor | float | tuple[float, ...]) -> Tensor:
    return torch.as_tensor(value, dtype=torch.float64)
