"""What a source of frames is. One subclass a file; each names the table of recording.toml it
reads."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest

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
        self.time: dict[int, float] = {}

    @abstractmethod
    def sight(self, frame: int) -> Sight:
        """Read one frame. Raises BadInput naming the file at fault."""

    @abstractmethod
    def files(self) -> list[Path]:
        """Every file this source may read."""


def check_metres(path: Path, points: np.ndarray) -> None:
    """Refuse positions (..., 3) [m], NaN where unknown, that no rope can have. Raises BadInput."""
    largest = float(np.max(np.abs(points), initial=0.0, where=~np.isnan(points)))
    if largest > FARTHEST:
        raise BadInput(f"{path}: a position of {largest:.4g} m; positions are in metres")
