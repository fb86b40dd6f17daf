"""What a model is fitted to: data, their noise and the stations at which both are compared."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from ropefit.inference.bins import Data, Stations, match
from ropefit.inference.noise import Noise

POTENTIALS_COST = 2  # evaluations without potentials, which take as long as one with them


class Exhausted(Exception):
    """Fits have taken as many evaluations as they may."""


@dataclass
class Work:
    """How many evaluations of a model fits have taken, however fast the machine is; most: from how
    many no further fit begins; exhausted: whether one would have."""

    evaluations: int = 0
    most: float = math.inf
    exhausted: bool = False

    @contextmanager
    def limited(self, most: float = math.inf) -> Iterator[Work]:
        """Let no fit begin after `most` evaluations: what is under way then is given up."""
        self.most, self.exhausted = most, False
        try:
            yield self
        except Exhausted:
            pass
        finally:
            self.most = math.inf

    def begin(self) -> None:
        """Begin a fit. Raises Exhausted."""
        if self.evaluations >= self.most:
            self.exhausted = True
            raise Exhausted

    def add(self, evaluations: int, potentials: bool) -> None:
        self.evaluations += evaluations * (POTENTIALS_COST if potentials else 1)


@dataclass(frozen=True)
class FitProblem:
    """The data of F frames, their noise, and the number of stations along the rope (of clouds);
    work: of all fits to them, to some of their frames and under other noise.

    Fits are compared only if they are of the same problem.
    """

    data: Data
    noise: Noise
    bins: int
    work: Work = field(default_factory=Work, compare=False)

    def match(self, x: np.ndarray) -> Stations:
        """Return the stations of the data against the curve through nodes x (F, K, 3) [m]."""
        return match(self.data, x, self.bins)

    def frames(self, index: np.ndarray) -> FitProblem:
        """Return the problem of some of its frames."""
        return replace(self, data=self.data.frames(index), noise=self.noise.frames(index))

    def without(self, dropped: np.ndarray) -> FitProblem:
        """Return the problem without the data of some frames (F,) bool."""
        return replace(self, data=replace(self.data, mask=self.data.mask & ~dropped[:, None]))

    def settled(self, x: np.ndarray) -> FitProblem:
        """Return the problem with only the points that count against the curve through nodes x."""
        return replace(self, data=self.data.settled(x))

    def under(self, noise: Noise) -> FitProblem:
        """Return the problem with other noise."""
        return replace(self, noise=noise)
