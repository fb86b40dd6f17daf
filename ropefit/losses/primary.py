"""The paper's four primary losses (section III-C), each as residual vectors whose norms are summed.

They work alike in 3D (D = 3, metres) and in the image plane (D = 2). x is (..., F, K, D): any
batch of candidates, F frames, K particles; the data are (F, N, D), padded, with a mask. Arrays of
numpy and tensors are treated alike.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from array_api_compat import array_namespace, is_torch_array
from jaxtyping import Float, Int

from ropefit.rod.either import Array, broadcast_to, like

Ropes = Float[Any, "*batch frames nodes dim"]


class Observed(NamedTuple):
    """What one frame's loss compares with, padded over frames.

    points (F, N, D); mask (F, N); segment (F, N) index of the segment a point belongs to;
    boundaries (F, K, D), the start and end points c_i of the segments; boundary_mask (F, K).
    """

    points: Array
    mask: Array
    segment: Array
    boundaries: Array
    boundary_mask: Array


class Residual(NamedTuple):
    """Vectors (..., F, M, D) from the simulation to the data and which of them count (F, M)."""

    vectors: Array
    mask: Array

    def loss(self) -> Array:
        """Return (..., F) sum of the norms; the derivative of a norm at zero is taken as zero."""
        xp = array_namespace(self.vectors)
        square = (self.vectors * self.vectors).sum(-1)
        positive = square > 0
        norm = xp.sqrt(xp.where(positive, square, 1.0))
        return xp.where(positive & self.mask, norm, 0.0).sum(-1)


def _to_segment(points: Array, start: Array, end: Array) -> Array:
    """Return (..., D) vectors from the nearest point of the line segment start-end to each
    point."""
    xp, edge = array_namespace(start), end - start
    square = (edge * edge).sum(-1)[..., None]
    along = ((points - start) * edge).sum(-1)[..., None] / xp.maximum(square, 1e-300)
    return points - (start + xp.clip(along, 0.0, 1.0) * edge)


def _of_segment(points: Array, x: Array, index: Array) -> Array:
    """Return the same as `_to_segment` for segment `index` (..., F, N) of the polylines x (..., F,
    K, D)."""
    return _to_segment(points, at_nodes(x, index), at_nodes(x, index + 1))


def at_nodes(
    x: Ropes, index: Int[Any, "*batch frames points"]
) -> Float[Any, "*batch frames points dim"]:
    """Return (..., F, M, D) the nodes `index` (..., F, M) of ropes x (..., F, K, D)."""
    wide = broadcast_to(index[..., None], (*index.shape, x.shape[-1]))
    return array_namespace(x).take_along_axis(x, wide, axis=-2)


def nearest_segment(
    points: Float[Any, "frames points dim"], x: Ropes
) -> Int[Any, "*batch frames points"]:
    """Return (..., F, N) index of the segment of x (..., F, K, D) nearest to each point (F, N,
    D)."""
    xp, x = array_namespace(x), x.detach() if is_torch_array(x) else x
    best, index = like(math.inf, x), 0
    for k in range(x.shape[-2] - 1):
        gap = _to_segment(points, x[..., k, None, :], x[..., k + 1, None, :])
        square = (gap * gap).sum(-1)
        closer = square < best
        best = xp.where(closer, square, best)
        index = xp.where(closer, k, index)
    return index


def point_to_line(x: Ropes, data: Observed) -> Residual:
    """Return L_PL: from each data point to the nearest point of the whole simulated polyline."""
    return Residual(_of_segment(data.points, x, nearest_segment(data.points, x)), data.mask)


def segment_to_particle(x: Ropes, data: Observed) -> Residual:
    """Return L_SP: from the boundaries c_i of the data's segments to the particles x_i."""
    return Residual(data.boundaries - x, data.boundary_mask)


def segment_to_line(x: Ropes, data: Observed) -> Residual:
    """Return L_SL: from each data point to the simulated segment that its own segment corresponds
    to."""
    index = broadcast_to(data.segment, (*x.shape[:-2], data.segment.shape[-1]))
    return Residual(_of_segment(data.points, x, index), data.mask)


def lowest_point(x: Ropes, lowest: Float[Any, "frames 3"], down: Float[Any, " 3"]) -> Residual:
    """Return L_LO: from the simulation's lowest point to the data's, lowest (F, 3), along down
    (3,).

    A polyline is lowest at one of its particles.
    """
    vectors = lowest[:, None, :] - at_nodes(x, (x @ down).argmax(-1)[..., None])
    xp = array_namespace(lowest)
    return Residual(vectors, xp.ones_like(lowest[:, :1], dtype=xp.bool))
