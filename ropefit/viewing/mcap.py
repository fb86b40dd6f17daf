"""An MCAP file of ROS 2 messages, for Foxglove and for ROS: every frame of a run.

Each layer is a topic of `visualization_msgs/Marker`, in metres in the frame `recording`, at the
recording's times. Written by rosbags, which reads bags as well: no further library, no ROS.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import StageFailed, WrongUsage
from ropefit.reporting.contents import RunContents
from ropefit.viewing.layers import Layer, frames

MARKER = "visualization_msgs/msg/Marker"
LINE_STRIP, SPHERE_LIST = 4, 7  # kinds of markers
ADD, DELETE = 0, 2
EVER = 0  # s: a marker stays until the next of its topic


def write_mcap(run: RunContents, out: Path) -> Path:
    """Write the file. Raises WrongUsage, StageFailed where it cannot be written."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    if out.is_dir():
        raise WrongUsage(f"{out}: is a folder; give a file as --out")
    store = get_typestore(Stores.ROS2_HUMBLE)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=".mcap-") as folder:
            bag = Path(folder) / "bag"
            with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
                topics: dict[str, Any] = {}
                for _, time, layers in frames(run):
                    stamp = round(time * 1e9)
                    for layer in layers:
                        topic = f"/rope/{layer.name.replace(' ', '_')}"
                        if topic not in topics:
                            topics[topic] = writer.add_connection(topic, MARKER, typestore=store)
                        message = store.serialize_cdr(_marker(store, layer, stamp), MARKER)
                        writer.write(topics[topic], stamp, message)
            (written,) = bag.glob("*.mcap")
            shutil.move(written, out)
    except OSError as error:
        raise StageFailed(f"cannot write {out}: {error.strerror or error}; give another --out")
    return out


def _marker(store: Any, layer: Layer, stamp: int) -> Any:
    """Return a layer as a marker; one without points removes what was shown before."""
    t = store.types
    points = layer.points[np.isfinite(layer.points).all(axis=1)]
    seconds, rest = divmod(stamp, 10**9)
    point, thick = t["geometry_msgs/msg/Point"], 2 * layer.radius
    header, moment = t["std_msgs/msg/Header"], t["builtin_interfaces/msg/Time"]
    return t[MARKER](
        header=header(moment(seconds, rest), "recording"),
        ns=layer.name, id=0, type=LINE_STRIP if layer.line else SPHERE_LIST,
        action=ADD if len(points) else DELETE,
        pose=t["geometry_msgs/msg/Pose"](
            point(0.0, 0.0, 0.0), t["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        ),
        scale=t["geometry_msgs/msg/Vector3"](thick, thick, thick),
        color=t["std_msgs/msg/ColorRGBA"](*(value / 255 for value in layer.colour), 1.0),
        lifetime=t["builtin_interfaces/msg/Duration"](EVER, EVER), frame_locked=False,
        points=[point(*map(float, at)) for at in points], colors=[],
        texture_resource="", texture=t["sensor_msgs/msg/CompressedImage"](
            header(moment(0, 0), ""), "",
            np.zeros(0, np.uint8),
        ),
        uv_coordinates=[], text="", mesh_resource="",
        mesh_file=t["visualization_msgs/msg/MeshFile"]("", np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )  # fmt: skip
