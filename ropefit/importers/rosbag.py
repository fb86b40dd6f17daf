"""What an open ROS bag holds: its topics, messages, transforms and poses, times in s."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers import rosmsg
from ropefit.importers.base import Entry, exists, readable
from ropefit.importers.tf import Pose, Transforms

TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


@contextmanager
def opened(source: Path) -> Iterator[Any]:
    """Provide the reader of a bag. Raises BadInput where it cannot be read."""
    exists(source)
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    known = get_typestore(Stores.ROS2_HUMBLE)  # for bags that carry no message definitions
    with readable(source, "a ROS bag"), AnyReader([source], default_typestore=known) as bag:
        yield bag


def entries(bag: Any) -> list[Entry]:
    """Return name, type and number of messages of every topic."""
    return [
        Entry(name, str(info.msgtype), int(info.msgcount))
        for name, info in sorted(bag.topics.items())
    ]


def messages(bag: Any, topic: str) -> Iterator[tuple[float, Any]]:
    """Return (time [s], message) of a topic; messages are decoded one at a time."""
    for connection, received, raw in bag.messages([c for c in bag.connections if c.topic == topic]):
        message = bag.deserialize(raw, connection.msgtype)
        yield rosmsg.stamp(message, received), message


def times_of(bag: Any, topic: str) -> list[float]:
    """Return the times [s] of a topic's messages."""
    return [time for time, _ in messages(bag, topic)]


def transforms_of(bag: Any, frame: str | None) -> Transforms:
    """Return all tf transforms. Raises WrongUsage where none names `frame`, if that is given."""
    out = Transforms()
    for connection, received, raw in bag.messages([c for c in bag.connections if c.msgtype in TF]):
        for item in bag.deserialize(raw, connection.msgtype).transforms:
            static = connection.topic.endswith("static")
            time = rosmsg.stamp(item, received)
            out.add(item.header.frame_id, item.child_frame_id, time, rosmsg.pose(item), static)
    if frame and frame.strip("/") not in out.frames():
        known = ", ".join(out.frames()) or "none"
        raise WrongUsage(f"--set frame={frame}: no such frame; there are {known}")
    return out


def poses_of(
    source: Path, bag: Any, topic: str | None
) -> tuple[list[float], list[Pose], str] | None:
    if topic is None or topic.startswith("tf:"):
        return None
    times, poses, frame = [], [], ""
    for time, message in messages(bag, topic):
        times.append(time)
        poses.append(rosmsg.pose(message))
        frame = str(message.header.frame_id)
    if not times:
        raise BadInput(f"{source}: topic {topic} holds no message")
    order = np.argsort(times, kind="stable")
    return [times[i] for i in order], [poses[i] for i in order], frame
