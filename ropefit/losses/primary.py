"""The paper's four primary losses (section III-C), each as residual vectors whose norms are summed.

They work alike in 3D (D = 3, metres) and in the image plane (D = 2). x is (..., F, K, D): any
batch of candidates, F frames, K particles; the data are (F, N, D), padded, with a mask.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

Ropes = Float[Tensor, "*batch frames nodes dim"]


class Observed(NamedTuple):
    """What one frame's loss compares with, padded over frames.

    points (F, N, D); mask (F, N); segment (F, N) index of the segment a point belongs to;
    boundaries (F, K, D), the start and end points c_i of the segments; boundary_mask (F, K).
    """

    points: Tensor
    mask: Tensor
    segment: Tensor
    boundaries: Tensor
    boundary_mask: Tensor


class Residual(NamedTuple):
    """Vectors (..., F, M, D) from the simulation to the data and which of them count (F, M)."""

    vectors: Tensor
    mask: Tensor

    def loss(self) -> Tensor:
        """Return (..., F) sum of the norms; the derivative of a norm at zero is taken as zero."""
        square = (self.vectors * self.vectors).sum(-1)
        positive = square > 0
        norm = torch.sqrt(torch.where(positive, square, 1.0))
        return torch.where(positive & self.mask, norm, 0.0).sum(-1)


def _to_segment(points: Tensor, start: Tensor, end: Tensor) -> Tensor:
    """Return (..., D) vectors from the nearest point of the line segment start-end to each
    point."""
    edge = end - start
    square = (edge * edge).sum(-1, keepdim=True)
    along = ((points - start) * edge).sum(-1, keepdim=True) / square.clamp_min(1e-300)
    return points - (start + along.clamp(0, 1) * edge)


def _of_segment(points: Tensor, x: Tensor, index: Tensor) -> Tensor:
    """Return the same as `_to_segment` for segment `index` (..., F, N) of the polylines x (..., F,
    K, D)."""
    index = index[..., None].expand(*index.shape, x.shape[-1])
    start = torch.gather(x, -2, index)
    end = torch.gather(x, -2, index + 1)
    return _to_segment(points, start, end)


def nearest_segment(
    points: Float[Tensor, "frames points dim"], x: Ropes
) -> Int[Tensor, "*batch frames points"]:
    """Return (..., F, N) index of the segment of x (..., F, K, D) nearest to each point (F, N,
    D)."""
    with torch.no_grad():
        best = torch.full(
            (*x.shape[:-2], points.shape[-2]), torch.inf, dtype=x.dtype, device=x.device
        )
        index = torch.zeros_like(best, dtype=torch.int64)
        for k in range(x.shape[-2] - 1):
            gap = _to_segment(points, x[..., k, None, :], x[..., k + 1, None, :])
            square = (gap * gap).sum(-1)
            closer = square < best
            best = torch.where(closer, square, best)
            index = torch.where(closer, k, index)
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
    index = data.segment.expand(*x.shape[:-2], data.segment.shape[-1])
    return Residual(_of_segment(data.points, x, index), data.mask)


def lowest_point(
    x: Ropes, lowest: Float[Tensor, "frames 3"], down: Float[Tensor, " 3"]
) -> Residual:
    """Return L_LO: from the simulation's lowest point to the data's, lowest (F, 3), along down
    (3,).

    A polyline is lowest at one of its particles.
    """
    node = (x @ down).argmax(-1)[..., None, None].expand(*x.shape[:-2], 1, x.shape[-1])
    vectors = lowest[:, None, :] - torch.gather(x, -2, node)
    return Residual(vectors, torch.ones_like(lowest[:, :1], dtype=torch.bool))
