"""A recording in the making: frames are put in and checked, files come out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.importers.plausible import check_depth, check_points
from ropefit.recordings.clouds import SCENE
from ropefit.recordings.writer import RecordingWriter

CLOCK_DIGITS = 6  # decimals of a second: finer than the clocks of sensors


@dataclass
class Draft(RecordingWriter):
    """Writes into `directory`; nothing is a recording before `finish`.

    frames counts what was put in; notes are sentences for the user.
    """

    progress: Callable[[float, str], None] = lambda share, text: None
    notes: list[str] = field(default_factory=list)
    frames: int = 0

    def note(self, sentence: str) -> None:
        """Add something the user should know; it is said once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def cloud(self, frame: int, points: np.ndarray, source: Path) -> None:
        """Add the points (N, 3) [m] of a frame; those that are not finite are dropped."""
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) == 0:
            self.note(f"frame {frame} has no finite points and is not imported")
            return
        check_points(source, frame, points, self.about.length, SCENE)
        self.write_cloud(frame, points)
        self.frames += 1

    def images(
        self,
        frame: int,
        color: np.ndarray,
        depth: np.ndarray | None,
        depth_scale: float,
        source: Path,
    ) -> None:
        """Add colour (H, W, 3) uint8 RGB and depth (H, W) uint16 of a frame."""
        self.write_images(frame, color, depth)
        if depth is not None:
            middle = check_depth(source, frame, depth, depth_scale)
            if self.frames == 0 and middle is not None:
                self.note(
                    f"half of the first depth image lies nearer than {middle:.3g} m; if that is "
                    f"wrong, give --set depth_scale=... (now {depth_scale:g} m per unit)"
                )
        self.frames += 1

    def markers(
        self, positions: np.ndarray, time: np.ndarray | None, source: Path, held: str | None
    ) -> None:
        """Add positions (F, M, 3) [m], NaN = not seen; time (F,) [s], if known.

        held: which markers the ends hold, `[[0], [12]]`, or None.
        """
        for frame, points in enumerate(positions):
            check_points(source, frame, points[np.isfinite(points).all(axis=1)], self.about.length)
        self.write_markers(positions, time, held)
        self.frames += len(positions)

    def end(
        self,
        frame: int,
        time: float,
        end: int,
        position: np.ndarray,
        orientation: np.ndarray | None,
    ) -> None:
        """Add the pose of an end in a frame: position (3,) [m]; orientation (4,) w x y z, None:
        pinned."""
        super().end(frame, round(float(time), CLOCK_DIGITS), end, position, orientation)

    def finish(self) -> None:
        """Write recording.toml and ends.csv. Raises BadInput where there is no frame."""
        if self.frames == 0:
            raise BadInput("no frame was found in the source; see what it holds with --list")
        super().finish()
