"""The ends of the rope over time: from ends.csv, or from the markers that are held."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.clocks import at_times
from ropefit.recordings.manifest import Manifest, inside
from ropefit.recordings.markers import Markers
from ropefit.recordings.recording import End
from ropefit.recordings.sources import check_metres
from ropefit.recordings.tables import read_table, whole

QUATERNION = ["qw", "qx", "qy", "qz"]
TANGENT = ["tx", "ty", "tz"]
NEEDED = ["frame", "end", "x", "y", "z"]
OPTIONAL = ["time", *QUATERNION, *TANGENT]


def read_ends(directory: Path, manifest: Manifest, markers: Markers | None) -> tuple[End, End]:
    """Return ends 0 and 1. Raises BadInput."""
    assert manifest.ends is not None
    if manifest.ends.file is not None:
        path = inside(directory, manifest.ends.file)
        ends, clocks = _from_file(path)
        if markers is None:
            return ends
        first, second = (
            at_times(path, which, end, clock, markers.time) if clock and markers.time else end
            for which, (end, clock) in enumerate(zip(ends, clocks, strict=True))
        )
        return first, second
    assert manifest.ends.markers is not None
    if markers is None:
        raise BadInput(f"{directory}: [ends] markers needs a [markers] table")
    held0, held1 = manifest.ends.markers
    inner = manifest.ends.arc_length is not None
    return _from_markers(markers, held0, 0, inner), _from_markers(markers, held1, 1, inner)


def end_times(path: Path) -> dict[int, float]:
    """Return {frame: time [s]} of an ends file, for sources that have no clock of their own; empty
    where the file has no times."""
    columns = read_table(path, NEEDED, OPTIONAL)
    return _clock(path, columns, np.arange(len(columns["frame"])))


def _clock(path: Path, columns: dict[str, np.ndarray], rows: np.ndarray) -> dict[int, float]:
    """Return {frame: time [s]} of some rows."""
    if "time" not in columns:
        return {}
    if not np.isfinite(columns["time"]).all():
        raise BadInput(f"{path}: column time has empty cells; give all times, or no such column")
    frame = whole(path, "frame", columns["frame"])
    return dict(zip(frame[rows].tolist(), columns["time"][rows].tolist(), strict=True))


def _from_file(path: Path) -> tuple[tuple[End, End], list[dict[int, float]]]:
    """Return ends 0 and 1 and, of each, the time [s] of every frame, if there are times."""
    columns = read_table(path, NEEDED, OPTIONAL)
    frame = whole(path, "frame", columns["frame"])
    which = whole(path, "end", columns["end"])
    if not np.isin(which, (0, 1)).all():
        raise BadInput(f"{path}: column end holds 0 (control point) or 1 (other end) only")
    position = np.stack([columns[axis] for axis in "xyz"], axis=1)
    check_metres(path, position)
    quaternion, roll_known = _orientation(path, columns)
    ends, clocks = [], []
    for end in (0, 1):
        rows = np.flatnonzero(which == end)
        if np.unique(frame[rows]).size != rows.size:
            raise BadInput(f"{path}: end {end} has two rows for one frame")
        ends.append(
            _end(path, end, frame[rows].tolist(), position[rows], quaternion[rows], roll_known)
        )
        clocks.append(_clock(path, columns, rows))
    return (ends[0], ends[1]), clocks


def _orientation(path: Path, columns: dict[str, np.ndarray]) -> tuple[np.ndarray, bool]:
    """Return quaternions (rows, 4), NaN where none is given, and whether they tell the roll: they
    do as quaternions, not as tangents."""
    rows = len(columns["frame"])
    for names, what in ((QUATERNION, "a quaternion"), (TANGENT, "a tangent")):
        present = [name for name in names if name in columns]
        if present and len(present) < len(names):
            needs, got = ",".join(names), ",".join(present)
            raise BadInput(f"{path}: {what} needs all of {needs}; got {got}")
    if "qw" in columns and "tx" in columns:
        raise BadInput(f"{path}: give quaternions or tangents, not both")
    if "qw" in columns:
        return np.stack([columns[name] for name in QUATERNION], axis=1), True
    if "tx" not in columns:
        return np.full((rows, 4), np.nan), True
    tangents = np.stack([columns[name] for name in TANGENT], axis=1)
    if (np.linalg.norm(tangents, axis=1) < 1e-9).any():
        raise BadInput(f"{path}: a tangent of no length")
    given = np.isfinite(tangents).all(axis=1)
    if (given != np.isfinite(tangents).any(axis=1)).any():
        raise BadInput(f"{path}: a tangent with a missing entry")
    out = np.full((rows, 4), np.nan)
    out[given] = [quaternion_along(tangent) for tangent in tangents[given]]
    return out, False


def _end(
    path: Path,
    end: int,
    frames: list[int],
    position: np.ndarray,
    quaternion: np.ndarray,
    roll_known: bool,
) -> End:
    if not frames:
        return End.free()
    given = np.isfinite(quaternion)
    if (given.any(axis=1) != given.all(axis=1)).any():
        raise BadInput(f"{path}: end {end} has a quaternion with a missing entry")
    clamped = given.all(axis=1)
    if clamped.any() and not clamped.all():
        row = frames[int(np.argmin(clamped))]
        raise BadInput(f"{path}: end {end} is clamped in some frames but has no direction in {row}")
    positions = dict(zip(frames, position, strict=True))
    if not clamped.any():
        return End("pinned", positions, {})
    norm = np.linalg.norm(quaternion, axis=1)
    if (np.abs(norm - 1) > 0.01).any():
        row = frames[int(np.argmax(np.abs(norm - 1)))]
        raise BadInput(f"{path}: end {end}, frame {row}: quaternion is not of unit length")
    turned = dict(zip(frames, quaternion / norm[:, None], strict=True))
    return End("clamped", positions, turned, roll_known)


def _from_markers(markers: Markers, held: list[int], end: int, inner: bool) -> End:
    """Return an end that one held marker pins, or two clamp along the line between them. inner:
    there may be rope, and markers, beyond it."""
    if not held:
        return End.free()
    count = markers.positions.shape[1]
    if any(not -count <= index < count for index in held):
        raise BadInput(f"{markers.path}: [ends] markers {held} but there are {count} markers")
    indices = sorted(index % count for index in held)
    outer = indices[0] if end == 0 else indices[-1]
    outermost = inner or outer == (0 if end == 0 else count - 1)
    if len(set(indices)) < len(indices) or not outermost:
        raise BadInput(
            f"{markers.path}: end {end} must hold the outermost marker, got {held}; if there is "
            "rope beyond it, give [ends] arc_length"
        )
    seen = np.isfinite(markers.positions[:, indices]).all(axis=(1, 2))
    rows = np.flatnonzero(seen)
    frames = [markers.frames[row] for row in rows]
    positions = dict(zip(frames, markers.positions[rows, outer], strict=True))
    if len(indices) == 1:
        return End("pinned", positions, {})
    along = markers.positions[rows, indices[1]] - markers.positions[rows, indices[0]]
    if (np.linalg.norm(along, axis=1) < 1e-9).any():
        raise BadInput(f"{markers.path}: the two held markers of end {end} coincide")
    orientation = [quaternion_along(tangent) for tangent in along]
    return End("clamped", positions, dict(zip(frames, orientation, strict=True)), roll_known=False)


def quaternion_along(tangent: np.ndarray) -> np.ndarray:
    """Return (4,) the rotation of least angle that takes e3 to the direction of `tangent` (3,)."""
    direction = tangent / np.linalg.norm(tangent)
    quaternion = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    norm = np.linalg.norm(quaternion)
    # Exactly against e3 the axis is arbitrary: take e1.
    return quaternion / norm if norm > 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
