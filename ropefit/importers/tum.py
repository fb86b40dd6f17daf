"""The TUM RGB-D layout: rgb.txt and depth.txt list images with their times."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.base import MAX_FRAMES, Entry, Importer, Options, exists, readable, thinned
from ropefit.importers.camera import steady_pose
from ropefit.importers.draft import Draft
from ropefit.importers.numbers import nearest, rotation, vector
from ropefit.recordings.manifest import inside

KINECT = (525.0, 525.0, 319.5, 239.5)  # the layout's documented default for 640 x 480
FORMATS = ["PNG", "JPEG"]
MOST_PIXELS = 20000


class TumOptions(Options):
    """intrinsics: fx,fy,cx,cy [pixels]. depth_scale: metres per unit. gap: how far apart [s] two
    images of one frame may be. camera_pose: x,y,z,qx,qy,qz,qw of a camera that stands still."""

    intrinsics: str | None = None
    depth_scale: float = Field(default=0.0002, gt=0, le=0.1)
    gap: float = Field(default=0.02, gt=0)
    camera_pose: str | None = None


class Tum(Importer):
    """rgb.txt, depth.txt and, for the camera's pose, groundtruth.txt where there is one."""

    format: ClassVar[str] = "tum"
    options: ClassVar[type[Options]] = TumOptions

    def contents(self, source: Path) -> list[Entry]:
        exists(source)
        names = ("rgb.txt", "depth.txt", "groundtruth.txt")
        return [
            Entry(name, "poses" if name[0] == "g" else "images", len(_table(source / name)))
            for name in names
            if (source / name).is_file()
        ]

    def read(self, source: Path, options: TumOptions, draft: Draft) -> None:
        exists(source)
        color, depth = (_images(source, name) for name in ("rgb.txt", "depth.txt"))
        times = np.array([time for time, _ in depth])
        pairs = []
        for time, path in color:
            at = nearest(times, time)
            if abs(times[at] - time) <= options.gap:
                pairs.append((path, depth[at][1]))
        if not pairs:
            raise BadInput(f"{source}: no colour and depth image within {options.gap:g} s")
        size = None
        chosen = thinned(pairs, options, source)
        for frame, (rgb, deep) in enumerate(chosen):
            draft.progress(frame / len(chosen), rgb.name)
            image, distance = _image(rgb, deep=False), _image(deep, deep=True)
            size = size or (image.shape[1], image.shape[0])
            if image.shape[1::-1] != size or distance.shape[::-1] != size:
                raise BadInput(f"{rgb}: images of different sizes; register depth to colour first")
            draft.images(frame, image, distance, options.depth_scale, deep)
        assert size is not None
        draft.note("frames are numbered from 0; their times are not kept in an RGB-D recording")
        draft.rgbd_table(
            size, _intrinsics(options, size, draft), _pose(source, options, draft),
            options.depth_scale,
        )  # fmt: skip


def _intrinsics(
    options: TumOptions, size: tuple[int, int], draft: Draft
) -> tuple[float, float, float, float]:
    if options.intrinsics is not None:
        fx, fy, cx, cy = vector("intrinsics", options.intrinsics, 4).tolist()
        return fx, fy, cx, cy
    if size != (640, 480):
        raise WrongUsage(f"images of {size[0]}x{size[1]}: give --set intrinsics=fx,fy,cx,cy")
    draft.note("intrinsics are the layout's default (525 px); --set intrinsics=fx,fy,cx,cy")
    return KINECT


def _pose(source: Path, options: TumOptions, draft: Draft) -> np.ndarray | None:
    if options.camera_pose is not None:
        values = vector("camera_pose", options.camera_pose, 7)[None]
    elif (source / "groundtruth.txt").is_file():
        rows = _table(source / "groundtruth.txt")
        with readable(source / "groundtruth.txt", "poses"):
            values = np.array([[float(cell) for cell in row[1:8]] for row in rows])
        if values.ndim != 2 or values.shape[1] != 7 or not np.isfinite(values).all():
            raise BadInput(f"{source / 'groundtruth.txt'}: rows are time tx ty tz qx qy qz qw")
    else:
        draft.note("no groundtruth.txt: the recording's frame is the camera's, check gravity")
        return None
    norm = np.linalg.norm(values[:, 3:], axis=1)
    if (np.abs(norm - 1) > 0.01).any():
        raise BadInput(f"{source}: a camera quaternion is not of unit length")
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    for pose, (value, length) in enumerate(zip(values, norm, strict=True)):
        poses[pose, :3, :3] = rotation(np.roll(value[3:], 1) / length)
        poses[pose, :3, 3] = value[:3]
    return steady_pose(source, poses)


def _table(path: Path) -> list[list[str]]:
    """Return rows of words; lines that begin with # are comments."""
    with readable(path, "a list of the TUM layout"):
        if path.stat().st_size > 1 << 28:
            raise BadInput(f"{path}: larger than 256 MiB, no list")
        lines = path.read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    if len(rows) > MAX_FRAMES:
        raise BadInput(f"{path}: more than {MAX_FRAMES} rows")
    return rows


def _images(source: Path, name: str) -> list[tuple[float, Path]]:
    path = source / name
    found = []
    for row in _table(path):
        with readable(path, "times and file names"):
            time, file = float(row[0]), row[1]
        if not np.isfinite(time):
            raise BadInput(f"{path}: {row[0]} is no time")
        found.append((time, inside(source, file)))
    if not found:
        raise BadInput(f"{path}: lists no image")
    return sorted(found)


def _image(path: Path, deep: bool) -> np.ndarray:
    """Return (H, W, 3) uint8 or (H, W) uint16; the size is checked before anything is decoded."""
    from PIL import Image

    with readable(path, "an image"), Image.open(path, formats=FORMATS) as image:
        if max(image.size) > MOST_PIXELS:
            raise BadInput(f"{path}: {image.size[0]}x{image.size[1]} pixels")
        if deep != image.mode.startswith("I"):
            need = "one channel of 16 bits" if deep else "8 bits a channel"
            raise BadInput(f"{path}: pixels of kind {image.mode}; {need} needed")
        return np.asarray(image).astype(np.uint16) if deep else np.asarray(image.convert("RGB"))
