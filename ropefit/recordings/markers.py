"""Motion-capture markers: csv or npz."""

from __future__ import annotations

import warnings
import zipfile
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest, inside
from ropefit.recordings.sources import Sight, Source, check_metres, check_spread
from ropefit.recordings.tables import read_table, whole

MAX_BYTES = 2 << 30


class Markers(Source):
    """positions (frames, markers, 3) [m]; NaN = not seen; marker order runs from end 0 to end 1."""

    table = "markers"

    def __init__(self, directory: Path, manifest: Manifest):
        super().__init__(directory, manifest)
        assert manifest.markers is not None
        self.path = inside(directory, manifest.markers.file)
        read = _read_npz if self.path.suffix == ".npz" else _read_csv
        self.frames, time, self.positions, arc = read(self.path)
        if time is not None:
            self.time = dict(zip(self.frames, time.tolist(), strict=True))
        count = self.positions.shape[1]
        if count < 2:
            raise BadInput(f"{self.path}: {count} marker; at least 2 are needed along the rope")
        arc = arc if manifest.markers.arc_length is None else np.array(manifest.markers.arc_length)
        if arc is not None and arc.shape != (count,):
            raise BadInput(f"{self.path}: {count} markers but {arc.size} entries in arc_length")
        if arc is not None and (np.any(~np.isfinite(arc)) or np.any(np.diff(arc) <= 0)):
            raise BadInput(
                f"{self.path}: arc_length must be finite and increase from end 0 to end 1"
            )
        self.arc_length = arc
        self._row = {frame: row for row, frame in enumerate(self.frames)}

    def sight(self, frame: int) -> Sight:
        points = self.positions[self._row[frame]]
        check_spread(self.path, frame, points, self.manifest.rope.length)
        return Sight(points=points, ordered=True, arc_length=self.arc_length)

    def files(self) -> list[Path]:
        return [self.path]


Raw = tuple[list[int], np.ndarray | None, np.ndarray, np.ndarray | None]


def _read_csv(path: Path) -> Raw:
    columns = read_table(path, ["frame", "marker", "x", "y", "z"], ["time"], nan=True)
    frame = whole(path, "frame", columns["frame"])
    marker = whole(path, "marker", columns["marker"])
    if marker.min() < 0 or marker.max() > 100_000:
        raise BadInput(
            f"{path}: marker numbers must run from 0; got {marker.min()}..{marker.max()}"
        )
    frames, row = np.unique(frame, return_inverse=True)
    count = int(marker.max()) + 1
    if frames.size * count > 10 * marker.size + 1000:
        raise BadInput(f"{path}: marker numbers up to {count - 1} in {marker.size} rows; renumber")
    if np.unique(row * count + marker).size != marker.size:
        raise BadInput(f"{path}: a marker occurs twice in one frame")
    if "time" in columns and not np.isfinite(columns["time"]).all():
        raise BadInput(f"{path}: column time holds NaN")
    positions = np.full((frames.size, count, 3), np.nan)
    positions[row, marker] = np.stack([columns[axis] for axis in "xyz"], axis=1)
    check_metres(path, positions)
    time = None
    if "time" in columns:
        time = np.full(frames.size, np.nan)
        time[row] = columns["time"]
    return frames.tolist(), time, positions, None


def _load_npz(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of an npz file that this reader knows; pickled ones are refused, never
    loaded."""
    known = ("positions", "time", "arc_length")
    try:
        with zipfile.ZipFile(path) as archive:
            declared = sum(item.file_size for item in archive.infolist())
        if declared <= MAX_BYTES:
            with (
                np.load(path, allow_pickle=False) as arrays,
                warnings.catch_warnings(action="ignore"),
            ):
                return {name: np.asarray(arrays[name]) for name in known if name in arrays}
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file; correct its name or add it")
    except Exception as error:  # zipfile and numpy raise whatever a damaged file makes them meet
        raise BadInput(f"{path}: not a readable npz without pickles ({error})")
    raise BadInput(f"{path}: declares {declared / 2**30:.1f} GiB; at most 2 GiB are read")


def _read_npz(path: Path) -> Raw:
    arrays = _load_npz(path)
    if "positions" not in arrays:
        raise BadInput(f"{path}: needs an array positions (frames, markers, 3)")
    positions, time = arrays["positions"], arrays.get("time")
    if positions.ndim != 3 or positions.shape[2] != 3 or positions.dtype.kind not in "fiu":
        raise BadInput(f"{path}: positions has shape {positions.shape}, not (frames, markers, 3)")
    if time is not None and (time.shape != positions.shape[:1] or time.dtype.kind not in "fiu"):
        raise BadInput(f"{path}: time has shape {time.shape}, not ({positions.shape[0]},)")
    if positions.shape[0] == 0:
        raise BadInput(f"{path}: has no frames")
    positions, time = positions.astype(float), None if time is None else time.astype(float)
    if np.isinf(positions).any() or not (time is None or np.isfinite(time).all()):
        raise BadInput(f"{path}: infinite positions or times that are no numbers")
    check_metres(path, positions)
    arc = arrays.get("arc_length")
    if arc is not None and arc.dtype.kind not in "fiu":
        raise BadInput(f"{path}: arc_length holds {arc.dtype}, not numbers")
    return list(range(len(positions))), time, positions, None if arc is None else arc.astype(float)
