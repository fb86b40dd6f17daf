"""RealSense recordings (.bag, .db3) through librealsense, depth registered to colour by it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from ropefit.errors import BadInput, StageFailed
from ropefit.importers.base import Entry, Importer, Options, exists, readable, thinned
from ropefit.importers.camera import given_pose
from ropefit.importers.draft import Draft

WAIT = 5000  # ms for the next frame of a file: longer than a disk takes
WAIT_MS = 500  # ms: also for what is on its way when the file has been played
COLOURS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}


class RealSenseOptions(Options):
    """gap: how far apart [s] the two images of a frame may be. camera_pose: x,y,z,qx,qy,qz,qw of
    the colour camera in the recording's frame."""

    gap: float = Field(default=0.02, gt=0)
    camera_pose: str | None = None


class RealSense(Importer):
    """A file that librealsense recorded, with a depth and a colour stream."""

    format: ClassVar[str] = "realsense"
    options: ClassVar[type[Options]] = RealSenseOptions

    def contents(self, source: Path) -> list[Entry]:
        rs = _library(source)
        with readable(source, "a RealSense recording"):
            device = rs.context().load_device(str(source))
            return [
                Entry(profile.stream_name(), str(profile.format()).split(".")[-1], profile.fps())
                for sensor in device.query_sensors()
                for profile in sensor.get_stream_profiles()
            ]

    def read(self, source: Path, options: RealSenseOptions, draft: Draft) -> None:
        rs = _library(source)
        found: dict[float, float] = {}  # time of the depth image -> of the colour image nearest it
        with _playing(rs, source) as playing:
            for depth, color in _pairs(playing):
                at, other = depth.get_timestamp(), color.get_timestamp()
                if at not in found or abs(at - other) < abs(at - found[at]):
                    found[at] = other  # a depth image comes with the colour before it too
        near = [at for at, other in found.items() if abs(at - other) <= 1e3 * options.gap]
        if not near:
            raise BadInput(f"{source}: no colour and depth image within {options.gap:g} s")
        chosen = set(thinned(near, options, source))
        align, matrix, size, scale = rs.align(rs.stream.color), None, None, 0.001
        with _playing(rs, source) as playing:
            scale = float(playing.profile.get_device().first_depth_sensor().get_depth_scale())
            frame = 0
            for depth, color in _pairs(playing):
                at = depth.get_timestamp()
                if at not in chosen or color.get_timestamp() != found[at]:
                    continue
                chosen.remove(at)
                both = align.process(playing.frames)
                image = both.get_color_frame()
                lens = image.profile.as_video_stream_profile().intrinsics
                matrix, size = (lens.fx, lens.fy, lens.ppx, lens.ppy), (lens.width, lens.height)
                if any(abs(c) > 1e-6 for c in lens.coeffs):
                    draft.note("the colour camera's images are distorted and are taken as they are")
                draft.progress(frame / max(len(near), 1), f"frame {frame}")
                deep = np.asanyarray(both.get_depth_frame().get_data()).astype(np.uint16)
                draft.images(frame, _rgb(source, image), deep, scale, source)
                frame += 1
        if matrix is None or size is None:
            raise BadInput(f"{source}: its frames cannot be read twice; is the file damaged?")
        draft.note("frames are numbered from 0; their times are not kept in an RGB-D recording")
        pose = given_pose(options.camera_pose) if options.camera_pose else None
        if pose is None:
            draft.note(
                "no --set camera_pose: the recording's frame is the colour camera's (x right, y "
                "down, z forward), check --gravity"
            )
        draft.rgbd_table(size, matrix, pose, scale)


class _Playing:
    """A file being played: its profile, whether it is over, the pair of frames that came last."""

    def __init__(self, pipeline: Any, profile: Any, over: Callable[[], bool]):
        self.pipeline, self.profile, self.over, self.frames = pipeline, profile, over, None


@contextmanager
def _playing(rs: Any, source: Path) -> Iterator[_Playing]:
    pipeline, config = rs.pipeline(), rs.config()
    with readable(source, "a RealSense recording"):
        config.enable_device_from_file(str(source), repeat_playback=False)
        player = config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback()
        player.set_real_time(False)
        # A stream plays as soon as one sensor starts: the other would lose its first frames.
        player.pause()
        profile = pipeline.start(config)
        player.resume()
        try:
            kinds = {stream.stream_type() for stream in profile.get_streams()}
            if not {rs.stream.depth, rs.stream.color} <= kinds:
                raise BadInput(f"{source}: needs a depth and a colour stream; see --list")
            over = rs.playback_status.stopped
            yield _Playing(pipeline, profile, lambda: player.current_status() == over)
        finally:
            pipeline.stop()


def _pairs(playing: _Playing) -> Iterator[tuple[Any, Any]]:
    """Return (depth frame, colour frame), as librealsense matches them."""
    waited = 0
    while waited < WAIT:
        over = playing.over()
        more, frames = playing.pipeline.try_wait_for_frames(WAIT_MS)
        if not more:
            waited = WAIT if over else waited + WAIT_MS
            continue
        waited = 0
        playing.frames = frames
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        if depth and color:
            yield depth, color


def _rgb(source: Path, image: Any) -> np.ndarray:
    name = str(image.profile.format()).split(".")[-1]
    if name not in COLOURS:
        raise BadInput(f"{source}: colour of format {name}; {', '.join(COLOURS)} are read")
    return np.ascontiguousarray(np.asanyarray(image.get_data())[:, :, COLOURS[name]])


def _library(source: Path) -> Any:
    exists(source)
    try:
        import pyrealsense2
    except ImportError:
        raise StageFailed(
            "RealSense recordings need librealsense; run pip install 'ropefit[realsense]'"
        )
    return pyrealsense2
