"""Motion capture as csv or npz."""

from __future__ import annotations

import re
import warnings
import zipfile
from pathlib import Path
from typing import ClassVar

import numpy as np

from ropefit.errors import BadInput
from ropefit.importers.base import Entry, Importer, Options, exists, readable
from ropefit.importers.draft import Draft
from ropefit.importers.markers import MarkerOptions, deliver
from ropefit.importers.mocap_exports import Capture, exported
from ropefit.importers.tables import Table

MAX_BYTES = 2 << 30
TIMES = ("time", "time (seconds)", "timestamp", "t")
FRAMES = ("frame", "frame#")
AXIS = re.compile(r"(.+?)[ _.:]?([xyz])(?: ?[\[(](?:m|mm|cm)[\])])?", re.IGNORECASE)


class Mocap(Importer):
    """An export of Motive (csv) or Qualisys (tsv) as written, csv with a column an axis (A_x, A_y,
    A_z or AX, AY, AZ), csv with a row a marker (frame, time, marker, x, y, z), or npz with
    positions (frames, markers, 3) and time (frames,)."""

    format: ClassVar[str] = "mocap"
    options: ClassVar[type[Options]] = MarkerOptions

    def contents(self, source: Path) -> list[Entry]:
        capture = _read(source)
        seen = np.isfinite(capture.positions).all(axis=2).sum(axis=0)
        return [Entry(n, "marker", int(c)) for n, c in zip(capture.names, seen, strict=True)]

    def read(self, source: Path, options: MarkerOptions, draft: Draft) -> None:
        names, time, positions, scale, up = _read(source)
        time = _clock(source, time, len(positions), options.rate)
        deliver(source, options, draft, names, time, positions, scale, up)


def _read(source: Path) -> Capture:
    exists(source)
    with readable(source, "motion capture"):
        if source.stat().st_size > MAX_BYTES:
            raise BadInput(f"{source}: larger than 2 GiB")
        if source.suffix.lower() == ".npz":
            return _npz(source)
        return _csv(source)


def _npz(source: Path) -> Capture:
    with zipfile.ZipFile(source) as archive:
        declared = sum(item.file_size for item in archive.infolist())
    if declared > MAX_BYTES:
        raise BadInput(f"{source}: declares {declared / 2**30:.1f} GiB; at most 2 GiB are read")
    with np.load(source, allow_pickle=False) as arrays, warnings.catch_warnings(action="ignore"):
        if "positions" not in arrays:
            raise BadInput(f"{source}: has no array positions, only {', '.join(arrays)}")
        positions = np.asarray(arrays["positions"])
        time = np.asarray(arrays["time"]) if "time" in arrays else None
        names = np.asarray(arrays["names"]) if "names" in arrays else None
    if positions.ndim != 3 or positions.shape[2] != 3 or positions.dtype.kind not in "fiu":
        raise BadInput(f"{source}: positions has shape {positions.shape}, not (frames, markers, 3)")
    count = positions.shape[1]
    labels = [str(i) for i in range(count)] if names is None else [str(name) for name in names]
    if len(labels) != count or len(set(labels)) < count:
        raise BadInput(f"{source}: {count} markers but {len(labels)} names, or a name twice")
    return Capture(labels, time, positions.astype(float))


def _csv(source: Path) -> Capture:
    read = Table.of(source)
    capture = exported(read)
    if capture is not None:
        return capture
    header = read.rows[0]
    low = [cell.lower() for cell in header]
    if len(set(header)) < len(header):
        raise BadInput(f"{source}: the header names a column twice")
    table = read.numbers(1, len(header))
    clock = next((table[:, low.index(name)] for name in TIMES if name in low), None)
    if {"marker", "x", "y", "z"} <= set(low):
        return _long(source, low, table, clock)
    names: dict[str, dict[str, int]] = {}
    for at, cell in enumerate(header):
        match = AXIS.fullmatch(cell)
        if match and cell.lower() not in TIMES + FRAMES:
            names.setdefault(match.group(1).strip(), {})[match.group(2).lower()] = at
    whole = {name: axes for name, axes in names.items() if len(axes) == 3}
    if not whole:
        raise BadInput(
            f"{source}: no marker found in the header {','.join(header)[:200]}; columns are "
            "A_x,A_y,A_z a marker, or frame,time,marker,x,y,z"
        )
    positions = np.stack([table[:, [a["x"], a["y"], a["z"]]] for a in whole.values()], axis=1)
    return Capture(list(whole), clock, positions)


def _long(source: Path, low: list[str], table: np.ndarray, clock: np.ndarray | None) -> Capture:
    if "frame" not in low:
        raise BadInput(f"{source}: rows a marker need a column frame")
    frame, marker = table[:, low.index("frame")], table[:, low.index("marker")]
    if not (np.isfinite(frame).all() and np.isfinite(marker).all()):
        raise BadInput(f"{source}: frame and marker must be numbers in every row")
    frames, row = np.unique(frame, return_inverse=True)
    markers, column = np.unique(marker, return_inverse=True)
    if frames.size * markers.size > 10 * len(table) + 1000:
        raise BadInput(
            f"{source}: {markers.size} markers in {frames.size} frames, {len(table)} rows"
        )
    if np.unique(row * markers.size + column).size < len(table):
        raise BadInput(f"{source}: a marker occurs twice in one frame")
    positions = np.full((frames.size, markers.size, 3), np.nan)
    positions[row, column] = table[:, [low.index(axis) for axis in "xyz"]]
    time = None
    if clock is not None:
        time = np.full(frames.size, np.nan)
        time[row] = clock
    labels = [f"{value:g}" for value in markers]
    return Capture(labels, time, positions)


def _clock(
    source: Path, time: np.ndarray | None, count: int, rate: float | None
) -> np.ndarray | None:
    """Return (F,) seconds: the file's, or frames at the rate given; None where there is neither."""
    if count == 0:
        raise BadInput(f"{source}: has no frames")
    if rate is not None:
        return np.arange(count) / rate
    if time is None:
        return None
    if time.shape != (count,) or time.dtype.kind not in "fiu":
        raise BadInput(f"{source}: time has shape {time.shape}, not ({count},)")
    return time.astype(float)
