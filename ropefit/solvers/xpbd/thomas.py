"""Thomas on the distance constraint: all segments of the chain in one tridiagonal solve."""

from __future__ import annotations

from torch import Tensor

from ropefit.solvers.xpbd.chain import Chain
from ropefit.solvers.xpbd.settings import RIDGE
from ropefit.solvers.xpbd.tridiagonal import solve_tridiagonal


class Thomas:
    """The paper's solver for inextensible ropes."""

    name = "thomas"

    def multipliers(self, chain: Chain, value: Tensor, direction: Tensor, alpha: float) -> Tensor:
        """Return the change of the multipliers (..., K-1), eq. (3), of the whole chain at once."""
        diagonal = (chain.weight_sum + alpha) * (1.0 + RIDGE) + RIDGE
        cosine = (direction[..., 1:, :] * direction[..., :-1, :]).sum(-1)
        return solve_tridiagonal(diagonal, -chain.weight[1:-1] * cosine, -value)

    def displacement(self, chain: Chain, impulse: Tensor) -> Tensor:
        """Return (..., K, 3) the particles' move: the sum, since the solve saw all constraints."""
        return chain.scatter @ impulse
