"""Jacobi on the distance constraint: every segment alone, each particle takes the mean."""

from __future__ import annotations

from torch import Tensor

from ropefit.solvers.xpbd.chain import Chain


class Jacobi:
    """The paper's solver for extensible ropes: cheap, and slow to make a rope inextensible."""

    name = "jacobi"

    def multipliers(self, chain: Chain, value: Tensor, direction: Tensor, alpha: float) -> Tensor:
        """Change of the multipliers, eq. (3), one constraint at a time. Shapes (..., K-1)."""
        return -value / (chain.weight_sum + alpha).clamp_min(1e-30)

    def displacement(self, chain: Chain, impulse: Tensor) -> Tensor:
        """(..., K, 3) move of the particles: mean over the constraints that touch each."""
        return chain.mean_scatter @ impulse
