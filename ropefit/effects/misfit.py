"""What a fit leaves, as an effect needs it to propose where its own fits start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ropefit.rod.setup import Setup


class Push(NamedTuple):
    """A force (3,) [N] at one place of the data (3,) [m] that explains most of what a frame leaves,
    and by how much that lowers its χ²."""

    frame: int
    place: np.ndarray
    force: np.ndarray
    gain: float


class Forces(Protocol):
    """Forces on L nodes of the rope in F frames: what they would explain of what a fit leaves, to
    first order, its own parameters refitted. places (F, L, 3) [m]: where the data have these
    nodes."""

    places: np.ndarray

    def gains(self, forces: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
        """Return (Q,) by how many nats each of forces (Q, F, L, 3) [N] would lower the misfit, and
        (Q,) the multiple of it that does, of a size of at most `most`."""
        ...


@dataclass(frozen=True)
class Misfit:
    """Where data and fitted rope differ.

    setup: as fitted; stated: as recorded, before any fit; points (F, P, 3) [m] of the recording and
    which count (F, P); nodes (F, N+1, 3) [m] of the rope, where they are and not where a misplaced
    camera reports them, NaN in frames without equilibrium. At the M stations: frame (M,), places
    (M, 3) [m] on the rope, moves (M, 3) [m] from the rope to the data. variance [m²] of the noise
    of a point, summed over the components that count; excess (F,) standard errors by which a
    frame's mean square exceeds the median one; terms: names of all parts of the model; pushes(): of
    frames that stand out, the strongest first; forces(nodes): on these L nodes.
    """

    setup: Setup
    stated: Setup
    points: np.ndarray
    counts: np.ndarray
    nodes: np.ndarray
    frame: np.ndarray
    places: np.ndarray
    moves: np.ndarray
    variance: float
    excess: np.ndarray
    terms: frozenset[str]
    pushes: Callable[[], list[Push]]
    forces: Callable[[tuple[int, ...]], Forces]
