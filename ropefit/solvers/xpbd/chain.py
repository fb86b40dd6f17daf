"""The chain's connectivity and weights as small constant matrices."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Chain:
    """Incidence of K particles and K-1 segments, with inverse masses; held ones weigh 0.

    weight (K,), weight_q (K-1,); difference (K-1, K): edges = difference @ x; scatter (K, K-1):
    moves of the particles from impulses on the segments, `mean_scatter` the same averaged over the
    constraints that touch a particle; first_q, second_q (K-1, K-2) the same for pairs of frames.
    """

    weight: Tensor
    weight_q: Tensor
    difference: Tensor
    scatter: Tensor
    mean_scatter: Tensor
    weight_sum: Tensor
    first_q: Tensor
    second_q: Tensor

    @staticmethod
    def build(held: Tensor, held_q: Tensor, weight: float = 1.0, weight_q: float = 1.0) -> Chain:
        """Return the chain of held particles and frames, which do not move.

        held (K,) bool, held_q (K-1,) bool.
        """
        nodes = held.numel()
        w = torch.where(held, 0.0, weight).to(torch.float64)
        wq = torch.where(held_q, 0.0, weight_q).to(torch.float64)
        eye = torch.eye(nodes, dtype=torch.float64)
        difference = eye[1:] - eye[:-1]
        scatter = w[:, None] * difference.T
        touching = difference.abs().sum(0)[:, None]
        eye_q = torch.eye(nodes - 1, dtype=torch.float64)
        first, second = eye_q[:, :-1] * wq[:, None], eye_q[:, 1:] * wq[:, None]
        touching_q = (eye_q[:, :-1] + eye_q[:, 1:]).sum(1)[:, None]
        return Chain(
            weight=w,
            weight_q=wq,
            difference=difference,
            scatter=scatter,
            mean_scatter=scatter / touching,
            weight_sum=w[1:] + w[:-1],
            first_q=first / touching_q,
            second_q=second / touching_q,
        )
