"""Folders of point clouds: PLY or PCD, one file a frame, in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest
from ropefit.recordings.patterns import list_frames
from ropefit.recordings.pcd import read_pcd
from ropefit.recordings.ply import read_ply
from ropefit.recordings.sources import Sight, Source, check_metres, check_spread

MAX_BYTES = 2 << 30


class Clouds(Source):
    """Unordered points (N, 3) [m] of each frame."""

    table = "clouds"

    def __init__(self, directory: Path, manifest: Manifest):
        super().__init__(directory, manifest)
        assert manifest.clouds is not None
        self.paths = list_frames(directory, manifest.clouds.pattern, "clouds.pattern")
        self.frames = list(self.paths)

    def sight(self, frame: int) -> Sight:
        points = read_cloud(self.paths[frame])
        check_spread(self.paths[frame], frame, points, self.manifest.rope.length)
        return Sight(points=points)

    def files(self) -> list[Path]:
        return list(self.paths.values())


def read_cloud(path: Path) -> np.ndarray:
    """Return (N, 3) [m] finite points of a PLY or PCD file. Raises BadInput."""
    readers = {".ply": read_ply, ".pcd": read_pcd}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise BadInput(f"{path}: clouds are .ply or .pcd files")
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadInput(f"{path}: larger than 2 GiB; thin the cloud out")
        points = reader(path, path.read_bytes())
    except OSError as error:
        raise BadInput(f"{path}: not readable ({error.strerror})")
    points = points[np.isfinite(points).all(axis=1)]
    check_metres(path, points)
    return points
