"""Terms: the parts of a model, each of which changes a setup by a few values.

A rope parameter, a calibration error or an effect. Values are searched in units of the term's own
scale, so that a step of one is a fair step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.effects.base import Effect
from ropefit.models.response import Change
from ropefit.rod.setup import Setup

Apply = Callable[[Setup, Tensor], Setup]


@dataclass(frozen=True)
class Term:
    """A part of a model that changes a setup: `apply` takes values in SI; a value is
    scale * (search variable).

    start, lower, upper (n,) in SI; prior (n,) one-sigma in SI, inf for none; log: the search
    variable is the logarithm of the value over its start. effect: that the term stands for, if any.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    apply: Apply
    start: np.ndarray
    scale: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    prior: np.ndarray
    log: bool = False
    nuisance: bool = False
    effect: Effect | None = None

    @property
    def size(self) -> int:
        return len(self.names)

    def value(self, u: np.ndarray) -> np.ndarray:
        """(n,) in SI from search variables (n,)."""
        return self.start * np.exp(u) if self.log else self.start + self.scale * u

    def search(self, value: np.ndarray) -> np.ndarray:
        """(n,) search variables of values in SI."""
        return np.log(value / self.start) if self.log else (value - self.start) / self.scale

    def slope(self, u: np.ndarray) -> np.ndarray:
        """(n,) derivative of the values in the search variables."""
        return self.value(u) if self.log else self.scale

    def interval(
        self, u: np.ndarray, covariance: np.ndarray, width: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n,), (n,) values `width` standard deviations to either side, within the bounds;
        covariance (n, n) of the search variables."""
        half = width * np.sqrt(np.maximum(np.diag(covariance), 0))
        least, most = self.search(self.lower), self.search(self.upper)
        low, high = np.clip(u - half, least, most), np.clip(u + half, least, most)
        return self.value(low), self.value(high)


def applied(setup: Setup, term: Term, value: Tensor) -> Setup:
    """Return a setup after a term of a value (n,) in SI."""
    return setup.after(lambda s: term.apply(s, value))


def moved(setup: Setup, term: Term, u: np.ndarray, k: int, step: float) -> Setup:
    """Return a setup after a term at search variables u (n,), the k-th one a step further."""
    return applied(setup, term, torch.from_numpy(term.value(u + step * np.eye(term.size)[k])))


def change_by(setup: Setup, term: Term, k: int) -> Change:
    """Return the change of a setup by a further term's k-th value, from the term's start."""
    return lambda step: moved(setup, term, np.zeros(term.size), k, step)
