"""A video by one camera that stands still, decoded by PyAV: single shapes, without depth."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.importers.base import Entry, Importer, Options, exists, readable
from ropefit.importers.camera import given_pose
from ropefit.importers.draft import Draft
from ropefit.importers.numbers import vector
from ropefit.recordings.manifest import read_toml

SMALL_PICTURE = 96  # pixels across, in which motion is looked for
MOST_PIXELS = 20000
RESTS = 2.0  # times the usual difference of two frames: with more the rope is on its way
ALIKE_SHARE = 0.25  # of the motion for each frame wanted: frames with less between them are alike
APART = 1.5  # times the usual difference of two frames: less is noise
FULL_FRAME = 36.0  # mm: width of the film that focal lengths "of 35 mm film" are stated for
FOCAL = "focal_length.35mm_equivalent"  # in the names of cameras' metadata


class FilmOptions(Options):
    """frames: how many are taken. fov: horizontal angle of view [degrees]; or intrinsics:
    fx,fy,cx,cy [pixels], or a TOML file with these. camera_pose: x,y,z,qx,qy,qz,qw."""

    frames: int = Field(default=12, ge=1)
    fov: float | None = Field(default=None, gt=1, lt=175)
    intrinsics: str | None = None
    camera_pose: str | None = None


class VideoOptions(FilmOptions):
    """ends: a table as ends.csv, by the video's frame numbers from 0."""

    ends: Path | None = None


class Video(Importer):
    """A clip of a rope that is held in one pose after another; its stillest frames are taken."""

    format: ClassVar[str] = "video"
    options: ClassVar[type[Options]] = VideoOptions

    def contents(self, source: Path) -> list[Entry]:
        with _opened(source) as file:
            return [Entry(f"track {s.index}", s.type, int(s.frames or 0)) for s in file.streams]

    def read(self, source: Path, options: VideoOptions, draft: Draft) -> None:
        film(source, options, draft)
        if options.ends is not None:
            draft.ends_of(options.ends)
        elif draft.about.length:
            draft.note("no --set ends: --solver equilibrium needs the poses of both ends")


def film(source: Path, options: FilmOptions, draft: Draft, part: range | None = None) -> list[int]:
    """Take the stillest frames of a film, or of a part of its frames; return their numbers, which
    count from the part's first."""
    small = [_gray(image) for _, image in _images(source, options.every, part)]
    if not small:
        raise BadInput(f"{source}: holds no image" + (f" in frames {part}" if part else ""))
    chosen = sorted((stillest(np.stack(small), options.frames) * options.every).tolist())
    size = None
    for frame, image in _images(source, options.every, part):
        if frame in chosen:
            draft.progress(draft.frames / len(chosen), f"frame {frame}")
            draft.images(frame, image, None, 1.0, source)
            size = (image.shape[1], image.shape[0])
    assert size is not None
    if options.camera_pose is None:
        draft.note(
            "no --set camera_pose: the recording's frame is the camera's (x right, y down, z "
            "forward), check --gravity"
        )
    pose = given_pose(options.camera_pose) if options.camera_pose else None
    draft.rgbd_table(size, _intrinsics(source, options, size), pose, None)
    draft.note("frames have the video's numbers; they count as single shapes at rest")
    return chosen


def stillest(small: np.ndarray, wanted: int) -> np.ndarray:
    """Return (at most `wanted`,) the frames to take of small grey pictures (F, H, W): the stillest
    first, with enough motion between any two of them."""
    moved = np.abs(np.diff(small, axis=0)).mean(axis=(1, 2))
    noise = np.median(moved) if len(moved) else 0.0
    path = np.concatenate([[0.0], np.cumsum(np.maximum(moved - APART * noise, 0.0))])
    if path[-1] == 0:  # as much from frame to frame all along, or nothing
        path = np.arange(len(small), dtype=float)
    taken: list[int] = []
    unrest = np.maximum(np.r_[moved, 0.0], np.r_[0.0, moved])
    for frame in np.argsort(unrest, kind="stable"):
        rests = unrest[frame] <= RESTS * np.median(unrest)
        if (
            rests
            and np.abs(path[taken] - path[frame]).min(initial=np.inf)
            > path[-1] * ALIKE_SHARE / wanted
        ):
            taken.append(int(frame))
    return np.sort(taken[:wanted])


def _gray(image: np.ndarray) -> np.ndarray:
    """Return (h, w) a small picture of the means of blocks."""
    step = max(1, image.shape[1] // SMALL_PICTURE)
    high, wide = (n // step * step for n in image.shape[:2])
    gray = image[:high, :wide].mean(axis=2, dtype=np.float32)
    return gray.reshape(high // step, step, wide // step, step).mean(axis=(1, 3))


@contextmanager
def _opened(source: Path) -> Iterator[Any]:
    exists(source)
    try:
        import av
    except ImportError:
        raise StageFailed("videos need PyAV; run pip install 'ropefit[video]'")
    with readable(source, "a video"), av.open(str(source)) as file:
        yield file


def _images(
    source: Path, every: int, part: range | None = None
) -> Iterator[tuple[int, np.ndarray]]:
    """Return (number, picture (H, W, 3) uint8 RGB) of every `every`-th frame of a part, upright."""
    first, stop = (part.start, part.stop) if part else (0, None)
    with _opened(source) as file:
        if not file.streams.video:
            raise BadInput(f"{source}: holds no image")
        for number, image in enumerate(islice(file.decode(video=0), first, stop)):
            if max(image.width, image.height) > MOST_PIXELS:
                raise BadInput(f"{source}: an image of {image.width}x{image.height} pixels")
            if number % every == 0:
                turns = round(getattr(image, "rotation", 0) / 90)
                yield number, np.rot90(image.to_ndarray(format="rgb24"), turns)


def _intrinsics(
    source: Path, options: FilmOptions, size: tuple[int, int]
) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy [px] as given, or by the focal length that the camera wrote."""
    if options.intrinsics is not None:
        text = options.intrinsics
        if Path(text).is_file():
            table = read_toml(Path(text))
            missing = [name for name in ("fx", "fy", "cx", "cy") if name not in table]
            if missing:
                raise BadInput(f"{text}: lacks {', '.join(missing)}")
            text = ",".join(str(table[name]) for name in ("fx", "fy", "cx", "cy"))
        fx, fy, cx, cy = vector("intrinsics", text, 4).tolist()
        return fx, fy, cx, cy
    middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    if options.fov is not None:
        focal = float(0.5 * size[0] / np.tan(np.radians(options.fov) / 2))
        return focal, focal, *middle
    with _opened(source) as file:
        given = [value for name, value in file.metadata.items() if name.lower().endswith(FOCAL)]
    if not given:
        raise WrongUsage(
            f"{source}: has no focal length of the camera; give --set fov=... (horizontal, "
            "degrees) or --set intrinsics=fx,fy,cx,cy"
        )
    focal = float(given[0]) / FULL_FRAME * max(size)
    return focal, focal, *middle
