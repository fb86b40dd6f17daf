"""Jacobi on the distance constraint: every segment alone, each particle takes the mean."""

from __future__ import annotations

from torch import Tensor

from ropefit.solvers.xpbd.chain import Chain


class Jacobi:
    """The paper's solver for extensible ropes: cheap, and slow to make a rope inextensible."""

    name = "jacobi"

    def multipliers(self, chain: Chain, value: Tensor, direction: Tensor, alpha: float) -> Tensor:
        """Return the change of the multipliers (..., K-1), eq. (3), each constraint alone."""
        return -value / (chain.weight_sum + alpha).clamp_min(1e-30)

    def displacement(self, chain: Chain, impulse: Tensor) -> Tensor:
        """Return (..., K, 3) the particles' move: the mean over the constraints that touch each."""
        return chain.mean_scatter @ impulse
