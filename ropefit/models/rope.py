"""What searches by a loss know of a rope: values in, states of its frames out, in torch.

`XpbdRope` runs Algorithm 1, `EquilibriumRope` settles. Both take batches of candidates and are
differentiable, by which the paper's losses are minimised. Least squares take a `Model` instead.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, Self

import numpy as np
import torch
from torch import Tensor

from ropefit.solvers.xpbd.reference import State


class Rope(Protocol):
    """F frames of one rope. step: of central differences in a logarithm; advice: what to do where
    it cannot be computed; device: where many are computed at once, None for compiled code."""

    step: ClassVar[float]
    advice: ClassVar[str]

    @property
    def device(self) -> torch.device | None: ...

    @property
    def control_node(self) -> int: ...

    @property
    def start(self) -> State:
        """Return where searches that move the control point set out."""
        ...

    @property
    def finest(self) -> Self:
        """Return the rope that reports every node of its rod."""
        ...

    def frames(self, index: np.ndarray) -> Self:
        """Return the same rope in some of its frames."""
        ...

    def settle(
        self, values: Tensor, move: Tensor | None = None, frame: Tensor | None = None
    ) -> State:
        """Return states for values (..., F, n), NaN where there is none. move (..., F, 3) [m] of
        the control point; frame (..., F, 4) of the first segment, or the clamp there."""
        ...
