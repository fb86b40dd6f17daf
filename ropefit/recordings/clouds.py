"""Folders of point clouds: PLY or PCD, one file a frame, in metres."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest
from ropefit.recordings.patterns import list_frames
from ropefit.recordings.sources import Sight, Source

MAX_POINTS = 50_000_000


class Clouds(Source):
    """Unordered points (N, 3) [m] of each frame."""

    table = "clouds"

    def __init__(self, directory: Path, manifest: Manifest):
        super().__init__(directory, manifest)
        assert manifest.clouds is not None
        self.paths = list_frames(directory, manifest.clouds.pattern, "clouds.pattern")
        self.frames = list(self.paths)

    def sight(self, frame: int) -> Sight:
        return Sight(points=read_cloud(self.paths[frame]))

    def files(self) -> list[Path]:
        return list(self.paths.values())


def read_cloud(path: Path) -> np.ndarray:
    """(N, 3) [m] finite points of a PLY or PCD file. Raises BadInput."""
    import open3d as o3d

    if path.suffix.lower() not in (".ply", ".pcd"):
        raise BadInput(f"{path}: clouds are .ply or .pcd files")
    declared = _declared_points(path)
    if declared > MAX_POINTS or declared > path.stat().st_size:  # at least one byte a point
        raise BadInput(f"{path}: declares {declared} points, more than the file can hold")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        try:
            cloud = o3d.io.read_point_cloud(path, remove_nan_points=False)
        except (RuntimeError, ValueError) as error:
            raise BadInput(f"{path}: not a readable point cloud ({error})")
    points = np.asarray(cloud.points, dtype=float).reshape(-1, 3)
    if len(points) < declared:
        raise BadInput(f"{path}: truncated or damaged: {len(points)} of {declared} points readable")
    return points[np.isfinite(points).all(axis=1)]


def _declared_points(path: Path) -> int:
    """The number of points that the header of a PLY or PCD file promises."""
    key = b"element vertex" if path.suffix.lower() == ".ply" else b"POINTS"
    end = b"end_header" if path.suffix.lower() == ".ply" else b"DATA"
    try:
        with path.open("rb") as file:
            head = file.read(65536)
    except OSError as error:
        raise BadInput(f"{path}: not readable ({error.strerror})")
    for line in head.splitlines():
        if line.strip().startswith(key):
            try:
                return int(line.split()[-1])
            except ValueError:
                break
        if line.strip().startswith(end):
            break
    raise BadInput(f"{path}: has no {path.suffix} header that says how many points it holds")
