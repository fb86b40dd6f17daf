"""ROS 1 and ROS 2 bags (sqlite3 and MCAP), read by rosbags; no ROS is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, field_validator

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers import rosmsg
from ropefit.importers.base import Entry, Importer, Options, thinned
from ropefit.importers.camera import steady_pose
from ropefit.importers.draft import Draft
from ropefit.importers.numbers import nearest, pose_at, product, rotation
from ropefit.importers.rosbag import (
    entries,
    messages,
    opened,
    poses_of,
    times_of,
    transforms_of,
)
from ropefit.importers.tf import Pose, Transforms

CLOUD = "sensor_msgs/msg/PointCloud2"
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
INFO = "sensor_msgs/msg/CameraInfo"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
HALF = np.sqrt(0.5)
# Rotations that take e3 to an axis of the gripper.
AXES = {
    "+x": (HALF, 0.0, HALF, 0.0), "-x": (HALF, 0.0, -HALF, 0.0), "+y": (HALF, -HALF, 0.0, 0.0),
    "-y": (HALF, HALF, 0.0, 0.0), "+z": (1.0, 0.0, 0.0, 0.0), "-z": (0.0, 1.0, 0.0, 0.0),
}  # fmt: skip


class RosOptions(Options):
    """clouds: a PointCloud2 topic; or color, depth and info: Image and CameraInfo topics.

    end0, end1: a PoseStamped or TransformStamped topic, or tf:FRAME. axis0, axis1: the axis of that
    frame (+x ... -z) that points along the rope from end 0 to end 1; without it the end is pinned.
    frame: the tf frame of the recording, gravity along -z. gap: how far apart [s] what belongs
    together may be. scale: metres per unit of clouds. depth_scale: metres per unit of depth.
    """

    clouds: str | None = None
    color: str | None = None
    depth: str | None = None
    info: str | None = None
    end0: str | None = None
    end1: str | None = None
    axis0: str | None = None
    axis1: str | None = None
    frame: str | None = None
    gap: float = Field(default=0.05, gt=0)
    scale: float = 1.0
    depth_scale: float | None = Field(default=None, gt=0, le=0.1)

    @field_validator("axis0", "axis1")
    @classmethod
    def _axis(cls, value: str | None) -> str | None:
        if value is not None and value not in AXES:
            raise ValueError(f"one of {', '.join(AXES)}")
        return value


class Ros(Importer):
    """A .bag file, a ROS 2 bag folder, or one of its files (.mcap, .db3)."""

    format: ClassVar[str] = "ros"
    options: ClassVar[type[Options]] = RosOptions

    def contents(self, source: Path) -> list[Entry]:
        with opened(source) as bag:
            return [*entries(bag), *transforms_of(bag, None).entries()]

    def read(self, source: Path, options: RosOptions, draft: Draft) -> None:
        with opened(source) as bag:
            _check_topics(source, bag, options)
            transforms = transforms_of(bag, options.frame)
            ends = [poses_of(source, bag, topic) for topic in (options.end0, options.end1)]
            if options.clouds:
                times = _clouds(source, bag, options, draft, transforms)
            else:
                times = _images(source, bag, options, draft, transforms)
        _ends(options, draft, transforms, ends, times)


def _check_topics(source: Path, bag: Any, options: RosOptions) -> None:
    wanted = {
        "clouds": (CLOUD,), "color": IMAGES, "depth": IMAGES, "info": (INFO,),
        "end0": POSES, "end1": POSES,
    }  # fmt: skip
    found = entries(bag)
    known = "; ".join(f"{entry.name} ({entry.kind})" for entry in found)
    for name, kinds in wanted.items():
        topic = getattr(options, name)
        if topic is None or topic.startswith("tf:"):
            continue
        kind = next((entry.kind for entry in found if entry.name == topic), None)
        if kind is None:
            raise WrongUsage(f"--set {name}={topic}: no such topic; there are {known}")
        if kind not in kinds:
            raise WrongUsage(f"--set {name}={topic}: holds {kind}, not {' or '.join(kinds)}")
    images = (options.color, options.depth, options.info)
    if bool(options.clouds) == all(images) or (not options.clouds and not all(images)):
        raise WrongUsage(
            f"{source}: choose what the frames are: --set clouds=TOPIC, or --set color=, depth= "
            f"and info=; there are {known}"
        )


def _clouds(
    source: Path, bag: Any, options: RosOptions, draft: Draft, transforms: Transforms
) -> dict[int, float]:
    assert options.clouds is not None
    wanted = set(thinned(times_of(bag, options.clouds), options, source))
    times: dict[int, float] = {}
    eye = None
    for time, message in messages(bag, options.clouds):
        if time not in wanted or time in times.values():
            continue
        frame = len(times)
        points = rosmsg.cloud(message) * options.scale
        place = _place(str(message.header.frame_id), time, options, transforms)
        if place is None:
            draft.note(f"frame {frame}: the cloud has no transform within {options.gap:g} s")
            continue
        with np.errstate(all="ignore"):  # points that were not seen are NaN
            points = points @ rotation(place[1]).T + place[0]
        eye = place[0]
        draft.progress(len(times) / max(len(wanted), 1), f"frame {frame}")
        draft.cloud(frame, points, source)
        times[frame] = time
    # Without transforms the cloud's frame may be the camera's or the world's: not known.
    draft.clouds_table(eye if options.frame else None)
    if not options.frame:
        draft.note("no --set frame given: the recording's frame is the clouds', check --gravity")
    return times


def _images(
    source: Path, bag: Any, options: RosOptions, draft: Draft, transforms: Transforms
) -> dict[int, float]:
    assert options.color is not None
    assert options.depth is not None
    assert options.info is not None
    info = next((message for _, message in messages(bag, options.info)), None)
    if info is None:
        raise BadInput(f"{source}: topic {options.info} holds no message")
    size, matrix, bent = rosmsg.intrinsics(info)
    if bent > 1e-6:
        draft.note(
            "the camera's images are distorted (CameraInfo D is not zero) and are taken as they "
            "are; import rectified topics if there are any"
        )
    colors = sorted(times_of(bag, options.color))
    if not colors:
        raise BadInput(f"{source}: topic {options.color} holds no message")
    pairs = {}
    for time in sorted(times_of(bag, options.depth)):
        match = colors[nearest(np.array(colors), time)]
        if abs(match - time) <= options.gap:
            pairs.setdefault(match, time)
    if not pairs:
        raise BadInput(f"{source}: no colour and depth image within {options.gap:g} s")
    chosen = thinned(sorted(pairs), options, source)
    times = dict(enumerate(chosen))
    frame_of = {time: frame for frame, time in times.items()}
    deep_of = {pairs[time]: frame for time, frame in frame_of.items()}
    depths, scale, camera = {}, 0.001, str(info.header.frame_id)
    for time, message in messages(bag, options.depth):
        if time in deep_of:
            image, scale = rosmsg.depth(message)
            if options.depth_scale is not None and scale != rosmsg.FINE:
                scale = options.depth_scale
            _check_size(source, options.depth, image, size)
            depths[deep_of[time]] = image
            if len(depths) == len(chosen):
                break
    for time, message in messages(bag, options.color):
        frame = frame_of.get(time)
        if frame is not None and frame in depths:
            image = rosmsg.color(message)
            _check_size(source, options.color, image, size)
            draft.progress(frame / len(chosen), f"frame {frame}")
            draft.images(frame, image, depths.pop(frame), scale, source)
    draft.rgbd_table(size, matrix, _camera_pose(source, camera, options, transforms, chosen), scale)
    if not options.frame:
        draft.note("no --set frame given: the recording's frame is the camera's, check --gravity")
    return times


def _check_size(source: Path, topic: str, image: np.ndarray, size: tuple[int, int]) -> None:
    if image.shape[1::-1] != size:
        raise BadInput(
            f"{source}: {topic} has {image.shape[1]}x{image.shape[0]} pixels, the CameraInfo says "
            f"{size[0]}x{size[1]}; choose depth registered to colour"
        )


def _camera_pose(
    source: Path, camera: str, options: RosOptions, transforms: Transforms, times: list[float]
) -> np.ndarray | None:
    if not options.frame:
        return None
    poses = []
    for time in times:
        place = transforms.find(camera, options.frame, time, options.gap)
        if place is not None:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotation(place[1]), place[0]
            poses.append(pose)
    if not poses:
        raise BadInput(f"{source}: no transform of {camera} within {options.gap:g} s of an image")
    return steady_pose(source, np.array(poses))


def _place(frame: str, time: float, options: RosOptions, transforms: Transforms) -> Pose | None:
    """Return the pose of a message's frame in the recording's."""
    if not options.frame or frame.strip("/") == options.frame.strip("/"):
        return np.zeros(3), np.array([1.0, 0, 0, 0])
    return transforms.find(frame, options.frame, time, options.gap)


def _ends(
    options: RosOptions,
    draft: Draft,
    transforms: Transforms,
    ends: list[tuple[list[float], list[Pose], str] | None],
    times: dict[int, float],
) -> None:
    for end, (topic, axis) in enumerate(
        ((options.end0, options.axis0), (options.end1, options.axis1))
    ):
        if topic is None:
            continue
        found = 0
        for frame, time in times.items():
            pose = _end_pose(topic, ends[end], time, options, transforms)
            if pose is None:
                continue
            found += 1
            turned = None if axis is None else product(pose[1], np.array(AXES[axis]))
            draft.end(frame, time, end, pose[0], turned)
        if not found:
            raise BadInput(f"{topic}: no pose of end {end} within {options.gap:g} s of any frame")
        if found < len(times):
            draft.note(f"end {end} has no pose in {len(times) - found} of {len(times)} frames")
    if options.end0 is None and options.end1 is None:
        draft.note("no end given (--set end0=, end1=): visible ends count as pinned")


def _end_pose(
    topic: str,
    known: tuple[list[float], list[Pose], str] | None,
    time: float,
    options: RosOptions,
    transforms: Transforms,
) -> Pose | None:
    if known is None:
        if not options.frame:
            raise WrongUsage(f"{topic}: ends taken from tf need --set frame=FRAME as well")
        return transforms.find(topic.removeprefix("tf:"), options.frame, time, options.gap)
    times, poses, frame = known
    pose = pose_at(
        np.array(times), np.array([p for p, _ in poses]), np.array([q for _, q in poses]), time,
        options.gap,
    )  # fmt: skip
    place = _place(frame, time, options, transforms)
    if pose is None or place is None:
        return None
    return place[0] + rotation(place[1]) @ pose[0], product(place[1], pose[1])
