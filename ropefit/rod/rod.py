"""The discrete rod in SI units: rigidities, weight and rest shape on the paper's strains.

Its energy is quadratic in stretch-shear C^S and bend-twist C^B; XPBD with compliance
α = 1/(EA l) and l/(4 EI) has the same equilibrium.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ropefit.rod.either import Array, alike, broadcast_to, like, namespace, plain
from ropefit.rod.fields import ROD


class Properties(NamedTuple):
    """What a rope is made of, segment by segment; every array may have more dimensions in front.

    length (N,) [m]; axial EA, shear GA [N]; bend EI, twist GJ [N m²]; density [kg/m];
    curvature (N, 3) [1/m]: of the rest shape, about the first and second director, and its twist.
    `math.inf` for EA and GA makes a rope that neither stretches nor shears.
    """

    length: Array
    axial: Array
    shear: Array
    bend: Array
    twist: Array
    density: Array
    curvature: Array


DIMS = tuple(len(field.shape) for field in ROD)  # without that of several ropes


class Rod(NamedTuple):
    """The discrete rod; N segments between N+1 nodes, with or without a dimension of R ropes.

    length (R, N) [m]; flexibility (R, N, 3) [1/N]: 1/GA, 1/GA, 1/EA; stiffness (R, N+1, 3) [N m]
    of C^B at each node (the first and last are those of clamps, zero without); rest (R, N+1, 3):
    vector part of the rest Darboux quaternion; load (R, N+1, 3) [N] on the nodes; moment (R, 2, 3)
    [N m] on the first and last segment, in space. See `fields.ROD`.
    """

    length: Array
    flexibility: Array
    stiffness: Array
    rest: Array
    load: Array
    moment: Array

    @property
    def arc(self) -> np.ndarray:
        """Return (R, N+1) [m] the rest arc length of the nodes."""
        return arc_length(self.length)

    def in_numpy(self) -> Rod:
        """Return the rod without tensors."""
        return Rod(*map(plain, self))

    def each(self, frames: int) -> Rod:
        """Return the rod once for each of `frames`, also what was the same in all."""
        return Rod(
            *(
                t if t.ndim > d else np.broadcast_to(t, (frames, *t.shape))
                for t, d in zip(self, DIMS, strict=True)
            )
        )

    def frames(self, index: np.ndarray) -> Rod:
        """Return the rod in some of the frames; what is the same in all stays as it is."""
        return Rod(
            *(t[index] if t.ndim > d and len(t) > 1 else t for t, d in zip(self, DIMS, strict=True))
        )


def arc_length(length: np.ndarray) -> np.ndarray:
    """Return (..., N+1) [m] the arc length of the nodes between segments of lengths (..., N)."""
    return np.concatenate([np.zeros_like(length[..., :1]), length.cumsum(-1)], axis=-1)


def uniform(
    *,
    length: float,
    segments: int,
    bend: Array | float,
    twist: Array | float | None = None,
    axial: Array | float = math.inf,
    shear: Array | float | None = None,
    density: Array | float = 1.0,
    curvature: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Properties:
    """Return a rope that is the same everywhere, of numbers, or arrays (...,) for several ropes.

    Without a twist rigidity it is 2/3 of the bending rigidity (a round incompressible section);
    without a shear rigidity it is the axial one. length [m], the rest as in `Properties`.
    """
    *values, rest = alike(
        length / segments,
        axial,
        axial if shear is None else shear,
        bend,
        2 / 3 * bend if twist is None else twist,
        density,
        curvature,
    )
    shape = np.broadcast_shapes(*(v.shape for v in values), rest.shape[:-1])
    spread = [broadcast_to(v[..., None], (*shape, segments)) for v in values]
    length_, axial_, shear_, bend_, twist_, density_ = spread
    turned = broadcast_to(rest[..., None, :], (*shape, segments, 3))
    return Properties(length_, axial_, shear_, bend_, twist_, density_, turned)


def build(
    p: Properties,
    gravity: Float[Any, " 3"],
    clamped: tuple[bool, bool],
    clamp_compliance: Float[Any, "*batch 2 2"] | None = None,
    kinks: Float[Any, "*batch nodes 3"] | None = None,
) -> Rod:
    """Return the discrete rod of a rope under gravity (3,) [m/s²].

    A clamp holds a frame at the very end of the rope: half a segment lies between it and the first
    frame. clamp_compliance (..., 2, 2) [rad/(N m)]: how far the clamps themselves yield to
    bending and to twist, 0 if not given; infinity lets go. kinks (..., N+1, 3) [rad]: turns of the
    rest shape at the nodes, besides its curvature. Each segment's l/EI is shared by the two nodes
    beside it, so properties may jump.
    """
    p = Properties(*alike(*p))
    xp = namespace(p.length)
    half_bend, half_twist = 0.5 * p.length / p.bend, 0.5 * p.length / p.twist
    soft = at_nodes(half_bend)
    soft = xp.stack([soft, soft, at_nodes(half_twist)], axis=-1)
    if clamp_compliance is not None:
        soft = _with_clamp_compliance(soft, like(clamp_compliance, soft))
    ends = np.ones((soft.shape[-2], 1))
    ends[0], ends[-1] = float(clamped[0]), float(clamped[1])
    turn = at_nodes(0.5 * p.length[..., None] * p.curvature, -2)
    if kinks is not None:
        turn = turn + like(kinks, turn)
    mass = at_nodes(0.5 * p.density * p.length)
    load = mass[..., None] * like(gravity, mass)
    return Rod(
        length=p.length,
        flexibility=1 / xp.stack([p.shear, p.shear, p.axial], axis=-1),
        stiffness=4 / soft * like(ends, soft),
        rest=half_turn(turn),
        load=load,
        moment=like(np.zeros((*load.shape[:-2], 2, 3)), load),
    )


def half_turn(turn: Float[Any, "*batch 3"]) -> Float[Any, "*batch 3"]:
    """Return the vector part (..., 3) of the quaternion that turns by |turn| [rad] about turn."""
    xp = namespace(turn)
    square = (turn * turn).sum(-1)[..., None]
    half = xp.sqrt(square + 1e-30) / 2
    return turn * xp.sinc(half / math.pi) / 2


def at_nodes(value: Array, axis: int = -1) -> Array:
    """Return the sum over the segments beside each node: (..., N) -> (..., N+1)."""
    xp = namespace(value)
    none = xp.zeros_like(value[..., :1] if axis == -1 else value[..., :1, :])
    return xp.concat([value, none], axis=axis) + xp.concat([none, value], axis=axis)


def _with_clamp_compliance(soft: Array, clamp_compliance: Array) -> Array:
    """Return the compliances of the bends (..., N+1, 3) with those of the clamps at both ends."""
    xp = namespace(soft, clamp_compliance)
    bend, twist = clamp_compliance[..., 0], clamp_compliance[..., 1]
    extra = xp.stack([bend, bend, twist], axis=-1)  # (..., 2, 3)
    shape = np.broadcast_shapes(soft.shape[:-2], extra.shape[:-2])
    soft = broadcast_to(soft, (*shape, *soft.shape[-2:]))
    extra = broadcast_to(extra, (*shape, 2, 3))
    first, last = soft[..., :1, :] + extra[..., :1, :], soft[..., -1:, :] + extra[..., 1:, :]
    return xp.concat([first, soft[..., 1:-1, :], last], axis=-2)
