"""Azure Kinect recordings (.mkv), decoded by PyAV; colour is projected into the depth image.

Tracks are known by their titles (COLOR, DEPTH) and matched by time; depth is 16-bit big-endian
grey in millimetres. The camera's calibration is an attachment of the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from ropefit.errors import BadInput, StageFailed
from ropefit.importers.base import Entry, Importer, Options, exists, readable, thinned
from ropefit.importers.camera import given_pose
from ropefit.importers.draft import Draft
from ropefit.importers.kinect_calibration import Register, calibration
from ropefit.importers.numbers import nearest

UNIT = 0.001  # m: what a depth of one means
MOST_PIXELS = 20000


class KinectOptions(Options):
    """gap: how far apart [s] the two images of a frame may be. camera_pose: x,y,z,qx,qy,qz,qw of
    the depth camera in the recording's frame."""

    gap: float = Field(default=0.02, gt=0)
    camera_pose: str | None = None


class Kinect(Importer):
    """A .mkv file of the Azure Kinect recorder, or of others that keep its layout."""

    format: ClassVar[str] = "kinect"
    options: ClassVar[type[Options]] = KinectOptions

    def contents(self, source: Path) -> list[Entry]:
        with _opened(source) as file:
            return [
                Entry(str(s.metadata.get("title") or s.metadata.get("filename") or s.index), s.type,
                      int(s.frames or 0))
                for s in file.streams
            ]  # fmt: skip

    def read(self, source: Path, options: KinectOptions, draft: Draft) -> None:
        with _opened(source) as file:
            known = calibration(source, _attached(source, file))
            times = {name: _times(source, file, name) for name in ("DEPTH", "COLOR")}
        colors = np.array(times["COLOR"])
        pairs = {}
        for time in times["DEPTH"]:
            match = float(colors[nearest(colors, time)])
            if abs(match - time) <= options.gap:
                pairs[time] = match
        if not pairs:
            raise BadInput(f"{source}: no colour and depth image within {options.gap:g} s")
        chosen = thinned(sorted(pairs), options, source)
        register: Register | None = None
        waiting = _images(source, "COLOR")
        color_time, color = next(waiting)
        frame = 0
        for time, depth in _images(source, "DEPTH"):
            if time not in chosen:
                continue
            while color_time < pairs[time]:
                color_time, color = next(waiting)
            if register is None:
                register = Register(source, known, depth.shape, color.shape[:2])
            draft.progress(frame / len(chosen), f"frame {frame}")
            seen, deep = register(color, depth)
            draft.images(frame, seen, deep, UNIT, source)
            frame += 1
        if register is None:
            raise BadInput(f"{source}: its frames cannot be read twice; is the file damaged?")
        draft.note("frames are numbered from 0; their times are not kept in an RGB-D recording")
        pose = given_pose(options.camera_pose) if options.camera_pose else None
        if pose is None:
            draft.note(
                "no --set camera_pose: the recording's frame is the depth camera's (x right, y "
                "down, z forward), check --gravity"
            )
        draft.rgbd_table(register.size, register.matrix, pose, UNIT)


@contextmanager
def _opened(source: Path) -> Iterator[Any]:
    exists(source)
    try:
        import av
    except ImportError:
        raise StageFailed("Kinect recordings need PyAV; run pip install 'ropefit[kinect]'")
    with readable(source, "an Azure Kinect recording"), av.open(str(source)) as file:
        yield file


def _track(source: Path, file: Any, name: str) -> Any:
    for stream in file.streams.video:
        if stream.metadata.get("title", "").upper() == name:
            return stream
    there = ", ".join(str(s.metadata.get("title", s.type)) for s in file.streams) or "none"
    raise BadInput(f"{source}: no track titled {name}; there are {there}")


def _times(source: Path, file: Any, name: str) -> list[float]:
    """Return times [s] of a track's images, increasing."""
    stream = _track(source, file, name)
    file.seek(0)
    times = [
        float(packet.pts * packet.time_base)
        for packet in file.demux(stream)
        if packet.pts is not None and packet.size
    ]
    if not times:
        raise BadInput(f"{source}: track {name} holds no image")
    return sorted(times)


def _images(source: Path, name: str) -> Iterator[tuple[float, np.ndarray]]:
    """Return (time [s], image) of a track: colour (H, W, 3) uint8 RGB, or depth (H, W) uint16."""
    with _opened(source) as file:
        stream = _track(source, file, name)
        for image in file.decode(stream):
            if max(image.width, image.height) > MOST_PIXELS:
                raise BadInput(f"{source}: an image of {image.width}x{image.height} pixels")
            deep = name == "DEPTH"
            if deep and "gray16" not in image.format.name:
                raise BadInput(f"{source}: depth of kind {image.format.name}; gray16 is read")
            data = image.to_ndarray(format="gray16le" if deep else "rgb24")
            yield float(image.time or 0.0), data


def _attached(source: Path, file: Any) -> bytes:
    """Return the calibration that the recorder attaches."""
    for stream in file.streams:
        name = str(stream.metadata.get("filename", ""))
        if stream.type == "attachment" and "calib" in name.lower():
            return bytes(stream.data)
    raise BadInput(f"{source}: has no calibration attached; is it of an Azure Kinect?")
