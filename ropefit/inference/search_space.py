"""Parameters as a search sees them: log scale, squeezed smoothly between their bounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.models.parameters import Range


@dataclass(frozen=True)
class Space:
    """The full parameter vector (n,) of which `free` (m indices) are searched.

    A search variable u and its parameter p are tied by log p = lo + (hi - lo) sigmoid(4 u / (hi -
    lo)), so that du ≈ d log p in the middle of the range and no value outside the bounds exists.
    """

    names: tuple[str, ...]
    free: tuple[int, ...]
    start: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @staticmethod
    def of(
        names: tuple[str, ...],
        free: list[str],
        start: dict[str, float],
        ranges: dict[str, Range],
    ) -> Space:
        """Return the space of named parameters with their ranges; `start` overrides where they
        start."""
        values, low, high = np.array([ranges[name] for name in names]).T
        values = np.array([start.get(n, v) for n, v in zip(names, values, strict=True)])
        indices = tuple(i for i, name in enumerate(names) if name in free)
        return Space(names, indices, values, low, high)

    @property
    def free_names(self) -> list[str]:
        return [self.names[i] for i in self.free]

    def to_search(self, values: np.ndarray) -> Tensor:
        """Return (..., n) parameters -> (..., m) search variables."""
        index = list(self.free)
        low, high = np.log(self.lower[index]), np.log(self.upper[index])
        share = np.clip((np.log(values[..., index]) - low) / (high - low), 1e-6, 1 - 1e-6)
        return torch.from_numpy((high - low) / 4 * np.log(share / (1 - share)))

    def to_values(self, u: Tensor) -> Tensor:
        """Return (..., m) search variables -> (..., n) parameters, the fixed ones at their
        start."""
        index = list(self.free)
        low = torch.from_numpy(np.log(self.lower[index]))
        high = torch.from_numpy(np.log(self.upper[index]))
        free = torch.exp(low + (high - low) * torch.sigmoid(4 * u / (high - low)))
        values = torch.from_numpy(self.start).expand(*u.shape[:-1], -1).clone()
        columns = {i: free[..., k] for k, i in enumerate(index)}
        return torch.stack([columns.get(i, values[..., i]) for i in range(len(self.names))], dim=-1)
