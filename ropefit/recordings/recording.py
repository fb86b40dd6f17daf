"""A recording in memory: what the sensors gave, whatever format it came in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from ropefit.recordings.manifest import Manifest
from ropefit.recordings.sources import Source

EndKind = Literal["free", "pinned", "clamped"]


@dataclass(frozen=True)
class End:
    """One end of the rope over time.

    position: {frame: (3,) [m]}; orientation: {frame: (4,) quaternion w x y z, R(q) e3 = tangent
    from end 0 to end 1}. Free: both empty. Pinned: no orientation. roll_known: False where the
    orientation stands for a tangent and its roll about that means nothing.
    """

    kind: EndKind
    position: Mapping[int, np.ndarray]
    orientation: Mapping[int, np.ndarray]
    roll_known: bool = True

    @staticmethod
    def free() -> End:
        return End("free", {}, {})


@dataclass(frozen=True)
class Recording:
    """One recording; frames are read from disk only when asked for."""

    path: Path
    manifest: Manifest
    source: Source  # the richest the recording has: markers, then clouds, then RGB-D
    ends: tuple[End, End] | None  # None: no [ends] in the recording
    files: tuple[Path, ...]  # all files the recording consists of, for its hash

    @property
    def name(self) -> str:
        return self.manifest.name

    @property
    def gravity(self) -> np.ndarray:
        """Return (3,) [m/s²]."""
        return np.array(self.manifest.gravity, dtype=float)

    @property
    def frames(self) -> list[int]:
        """Return frame numbers, increasing."""
        return self.source.frames

    def times(self, frames: Sequence[int]) -> np.ndarray | None:
        """Return (F,) [s] the times of frames, NaN where one has none; None where none has."""
        time = np.array([self.source.time.get(frame, np.nan) for frame in frames])
        return time if np.isfinite(time).any() else None
