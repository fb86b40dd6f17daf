"""What a source of frames is. One subclass a file; each names the table of recording.toml it
reads."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import MAX_LENGTH, Manifest

FARTHEST = 1e7  # m; a larger coordinate is no position of a rope


@dataclass(frozen=True)
class Sight:
    """One frame of a source; what it does not have is None.

    points: (N, 3) [m] in the recording's frame; ordered: the points run from end 0 to end 1 and
    arc_length (N,) [m] may be known (markers). color: (H, W, 3) uint8 RGB. depth: (H, W) [m], 0 =
    none.
    """

    points: np.ndarray | None = None
    ordered: bool = False
    arc_length: np.ndarray | None = None
    color: np.ndarray | None = None
    depth: np.ndarray | None = None


class Source(ABC):
    """Frames of one kind of sensor data. Opening it lists the frames; `sight` reads one."""

    table: ClassVar[str]

    def __init__(self, directory: Path, manifest: Manifest):
        self.directory = directory
        self.manifest = manifest
        self.frames: list[int] = []
        self.time: dict[int, float] = {}  # {frame: [s]}; empty: it has no clock

    @abstractmethod
    def sight(self, frame: int) -> Sight:
        """Read one frame. Raises BadInput naming the file at fault."""

    @abstractmethod
    def files(self) -> list[Path]:
        """Return every file this source may read."""


def check_metres(path: Path, points: np.ndarray) -> None:
    """Refuse positions (..., 3) [m], NaN where unknown, that no rope can have. Raises BadInput."""
    largest = float(np.max(np.abs(points), initial=0.0, where=~np.isnan(points)))
    if largest > FARTHEST:
        raise BadInput(f"{path}: a position of {largest:.4g} m; positions are in metres")


def check_spread(
    path: Path, frame: int, points: np.ndarray, length: float | None, times: float = 1.0
) -> None:
    """Refuse a frame whose points (N, 3), NaN where unknown, cannot all lie on a rope: millimetres?

    Half of the points within a box longer than the rope is no matter of outliers. times: of the
    length, where a whole scene may be seen. Raises BadInput.
    """
    seen = points[np.isfinite(points).all(axis=1)]
    if len(seen) < 2:
        return
    low, high = np.quantile(seen, (0.25, 0.75), axis=0)
    spread, most = float(np.linalg.norm(high - low)), length or MAX_LENGTH
    if spread > (times if length else 1.0) * most:
        rope = f"the rope is {most:g} m long" if length else f"ropes reach {most:g} m"
        raise BadInput(
            f"{path}: frame {frame}: the points spread over {spread:.4g} m but {rope}; "
            "positions are in metres"
        )
