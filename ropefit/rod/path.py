"""The path of the ends between the frames in which their poses were recorded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.quaternion import conjugate_product, normalise


class EndPath(NamedTuple):
    """Cubic splines in time through the poses of both ends, clip by clip, for F frames.

    time (F,) [s] of the frames, on a clock on which clips do not overlap; first, last (F,): the
    first and the last of the P pieces of a frame's clip, and earliest, latest (F,) [s]: the ends
    rest before and after. start (P,) [s] of the pieces; position (4, P, 2, 3) [m] and turn
    (4, P, 2, 4), quaternions: their coefficients, the highest power first. step [s] from frame to
    frame.
    """

    time: np.ndarray
    first: np.ndarray
    last: np.ndarray
    earliest: np.ndarray
    latest: np.ndarray
    start: np.ndarray
    position: np.ndarray
    turn: np.ndarray
    step: float

    def moved(self, lag: float) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the ends go, (F, 2, 3) [m], and how their clamps turn about their own
        axes, (F, 2, 4), in a time lag [s] after each frame."""
        (here, now), (there, later) = self._at(self.time), self._at(self.time + lag)
        return there - here, conjugate_product(normalise(now), normalise(later))

    def later(self, lag: float) -> EndPath:
        """Return the path as seen from a time lag [s] after each frame."""
        return self._replace(time=self.time + lag)

    def outside(self, most: float) -> np.ndarray:
        """Return (F,) bool: frames more than `most` [s] before or after the path."""
        return (self.time < self.earliest - most) | (self.time > self.latest + most)

    def frames(self, index: np.ndarray) -> EndPath:
        """Return the path for some of the frames."""
        own = ("time", "first", "last", "earliest", "latest")
        return self._replace(**{name: getattr(self, name)[index] for name in own})

    def _at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        time = np.minimum(np.maximum(time, self.earliest), self.latest)
        piece = np.searchsorted(self.start, time, side="right") - 1
        piece = np.minimum(np.maximum(piece, self.first), self.last)
        after = (time - self.start[piece])[:, None, None]
        position, turn = self.position[0, piece], self.turn[0, piece]
        for power in range(1, 4):
            position = position * after + self.position[power, piece]
            turn = turn * after + self.turn[power, piece]
        return position, turn
