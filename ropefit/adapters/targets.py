"""Target shapes for control: a csv of points, with or without their place on the rope."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.sources import check_metres
from ropefit.recordings.tables import read_table, whole

MAX_CELLS = 1_000_000  # shapes x points of the largest shape


@dataclass(frozen=True)
class Targets:
    """C target shapes of up to M points: points (C, M, 3) [m], arc (C, M) [m]; NaN = none,
    unknown."""

    number: np.ndarray
    points: np.ndarray
    arc: np.ndarray
    sha256: str


def read_targets(path: Path, length: float) -> Targets:
    """Read `x,y,z` with optional columns `arc_length` [m] and `target` (number of the shape).

    Without arc_length a point may be met by any place on the rope. Raises BadInput.
    """
    columns = read_table(path, ["x", "y", "z"], ["arc_length", "target"])
    xyz = np.stack([columns[axis] for axis in "xyz"], axis=1)
    if len(xyz) > 10_000:
        raise BadInput(f"{path}: {len(xyz)} target points; at most 10000")
    check_metres(path, xyz)
    arc = columns.get("arc_length", np.full(len(xyz), np.nan))
    if np.any((arc < 0) | (arc > length)):
        raise BadInput(f"{path}: arc_length outside the rope (0 to {length:g} m)")
    number = columns.get("target", np.zeros(len(xyz)))
    if not np.isfinite(number).all():
        raise BadInput(f"{path}: column target has empty cells")
    number = whole(path, "target", number)
    labels, index = np.unique(number, return_inverse=True)
    most = int(np.bincount(index).max())
    if len(labels) * most > MAX_CELLS:
        raise BadInput(f"{path}: {len(labels)} shapes of up to {most} points; split the file")
    points = np.full((len(labels), most, 3), np.nan)
    places = np.full((len(labels), most), np.nan)
    for case in range(len(labels)):
        mine = index == case
        points[case, : mine.sum()], places[case, : mine.sum()] = xyz[mine], arc[mine]
    return Targets(labels, points, places, hashlib.sha256(path.read_bytes()).hexdigest())
