"""Sources to import, each written by its format's own writer."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.factories import rope_points

FRAMES = 4
CAMERA = (np.array([0.3, -1.2, 0.0]), (np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0))  # looks along +y
FOCAL, WIDTH, HEIGHT = 200.0, 160, 120


def cloud_points(frame: int) -> np.ndarray:
    """(400, 3) [m] points around the rope."""
    line = rope_points(frame, 400)
    return line + np.random.default_rng(frame).normal(0, 0.002, line.shape)


def rendered(frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3) and depth (H, W) [m] of a red rope before a grey wall, seen by CAMERA."""
    color = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    depth = np.full((HEIGHT, WIDTH), 1.8)
    line = rope_points(frame, 2000) - CAMERA[0]
    x, y, z = line[:, 0], -line[:, 2], line[:, 1]
    column = np.round(FOCAL * x / z + WIDTH / 2).astype(int)
    row = np.round(FOCAL * y / z + HEIGHT / 2).astype(int)
    for shift in (-1, 0, 1):
        color[row + shift, column] = (230, 40, 20)
        depth[row + shift, column] = z
    return color, depth


def _typestore(version: int):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    if "tf2_msgs/msg/TFMessage" not in store.fielddefs:
        text = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(text, "tf2_msgs/msg/TFMessage"))
    return store


class Ros:
    """Makes messages of one ROS version."""

    def __init__(self, version: int):
        self.version = version
        self.store = _typestore(version)

    def make(self, kind: str, /, **fields):
        """A message by its short name."""
        return self.store.types[kind](**fields)

    def header(self, time: float, frame: str):
        stamp = self.make(
            "builtin_interfaces/msg/Time", sec=int(time), nanosec=round(time % 1 * 1e9)
        )
        more = {"seq": 0} if self.version == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def cloud(self, time: float, points: np.ndarray, frame: str = "world"):
        fields = [
            self.make("sensor_msgs/msg/PointField", name=n, offset=4 * i, datatype=7, count=1)
            for i, n in enumerate("xyz")
        ]
        data = np.hstack([points, np.zeros((len(points), 1))]).astype("<f4")
        return self.make(
            "sensor_msgs/msg/PointCloud2", header=self.header(time, frame), height=1,
            width=len(points), fields=fields, is_bigendian=False, point_step=16,
            row_step=16 * len(points), data=data.view(np.uint8).ravel(), is_dense=True,
        )  # fmt: skip

    def image(self, time: float, pixels: np.ndarray, encoding: str):
        height, width = pixels.shape[:2]
        data = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
        return self.make(
            "sensor_msgs/msg/Image", header=self.header(time, "camera"), height=height,
            width=width, encoding=encoding, is_bigendian=0, step=data.shape[1], data=data.ravel(),
        )  # fmt: skip

    def info(self, time: float):
        matrix = np.array([FOCAL, 0, WIDTH / 2, 0, FOCAL, HEIGHT / 2, 0, 0, 1.0])
        upper = self.version == 1
        more = {
            "DKRP"[i] if upper else "dkrp"[i]: value
            for i, value in enumerate([np.zeros(5), matrix, np.eye(3).ravel(), np.zeros(12)])
        }
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0,
            do_rectify=False,
        )  # fmt: skip
        return self.make(
            "sensor_msgs/msg/CameraInfo", header=self.header(time, "camera"), height=HEIGHT,
            width=WIDTH, distortion_model="plumb_bob", binning_x=0, binning_y=0, roi=region, **more,
        )  # fmt: skip

    def pose(self, time: float, position, quaternion=(1.0, 0, 0, 0), frame: str = "world"):
        return self.make(
            "geometry_msgs/msg/PoseStamped", header=self.header(time, frame),
            pose=self.make(
                "geometry_msgs/msg/Pose",
                position=self.make("geometry_msgs/msg/Point", **self._xyz(position)),
                orientation=self._turn(quaternion),
            ),
        )  # fmt: skip

    def tf(self, time: float, parent: str, child: str, position, quaternion=(1.0, 0, 0, 0)):
        return self.make(
            "geometry_msgs/msg/TransformStamped", header=self.header(time, parent),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", **self._xyz(position)),
                rotation=self._turn(quaternion),
            ),
        )  # fmt: skip

    def tree(self, *links):
        return self.make("tf2_msgs/msg/TFMessage", transforms=list(links))

    def _xyz(self, values) -> dict[str, float]:
        return dict(zip("xyz", map(float, values), strict=True))

    def _turn(self, quaternion):
        w, x, y, z = map(float, quaternion)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def write(
        self, path: Path, messages: list[tuple[str, float, object]], storage: str = ""
    ) -> Path:
        """A bag of (topic, time, message), written by rosbags."""
        if self.version == 1:
            from rosbags.rosbag1 import Writer

            bag = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
            bag = Writer(path, version=9, storage_plugin=plugin)
        with bag:
            known = {}
            for topic, time, message in messages:
                kind = message.__msgtype__
                if topic not in known:
                    known[topic] = bag.add_connection(topic, kind, typestore=self.store)
                if self.version == 1:
                    raw = self.store.serialize_ros1(message, kind)
                else:
                    raw = self.store.serialize_cdr(message, kind)
                bag.write(known[topic], round(time * 1e9) + 1, raw)
        return path


def bag(path: Path, version: int, storage: str = "") -> Path:
    """Clouds in the camera's frame, images, ends as poses and in tf."""
    ros = Ros(version)
    messages: list[tuple[str, float, object]] = [
        ("/tf_static", 100.0, ros.tree(ros.tf(100.0, "world", "camera", *CAMERA)))
    ]
    for frame in range(FRAMES):
        time = 100.0 + 0.1 * frame
        line = rope_points(frame, 50)
        seen = cloud_points(frame) - CAMERA[0]
        inside = np.stack([seen[:, 0], -seen[:, 2], seen[:, 1]], axis=1)
        color, depth = rendered(frame)
        millimetres = np.round(depth * 1000).astype("<u2")
        messages += [
            ("/points", time, ros.cloud(time, inside, "camera")),
            ("/color", time, ros.image(time, color, "rgb8")),
            ("/depth", time + 0.004, ros.image(time + 0.004, millimetres, "16UC1")),
            ("/depth_metres", time, ros.image(time, depth.astype("<f4"), "32FC1")),
            ("/info", time, ros.info(time)),
            ("/tf", time, ros.tree(ros.tf(time, "world", "gripper", line[0]))),
        ]
        for half in (0.0, 0.05):
            messages.append(("/far", time + half, ros.pose(time + half, line[-1])))
    return ros.write(path, messages, storage)


def tum(directory: Path) -> Path:
    """A folder of the TUM layout; images written by Pillow."""
    from PIL import Image

    lists = {"rgb": ["# color images"], "depth": ["# depth maps"]}
    for frame in range(FRAMES):
        color, depth = rendered(frame)
        units = np.round(depth * 5000).astype(np.uint16)
        for name, pixels, late in (("rgb", color, 0.0), ("depth", units, 0.011)):
            (directory / name).mkdir(parents=True, exist_ok=True)
            time = f"{1305031102.1 + frame / 30 + late:.6f}"
            Image.fromarray(pixels).save(directory / name / f"{time}.png")
            lists[name].append(f"{time} {name}/{time}.png")
    for name, lines in lists.items():
        (directory / f"{name}.txt").write_text("\n".join(lines) + "\n")
    position, (w, x, y, z) = CAMERA
    row = " ".join(f"{value:.6f}" for value in [*position, x, y, z, w])
    (directory / "groundtruth.txt").write_text(f"# timestamp tx ty tz qx qy qz qw\n1.0 {row}\n")
    return directory


def c3d(path: Path, unit: str = "mm", count: int = 7) -> Path:
    """A C3D file written by ezc3d; marker B2 is hidden in frame 1."""
    import ezc3d

    file = ezc3d.c3d()
    names = [f"B{i}" for i in range(count)]
    points = np.stack([rope_points(frame, count).T for frame in range(FRAMES)], axis=2)
    points = points * {"mm": 1000.0, "m": 1.0}[unit]
    points[:, 2, 1] = np.nan
    file["parameters"]["POINT"]["RATE"]["value"] = [50.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["data"]["points"] = np.concatenate([points, np.ones((1, count, FRAMES))])
    file.write(str(path))
    return path


def wide_csv(path: Path, scale: float = 1.0) -> Path:
    """Motion capture with a column an axis; the markers are in no order."""
    names = ["tail", "mid", "head", "second"]
    order = [3, 2, 0, 1]
    header = ["Time"] + [f"{name}_{axis}" for name in names for axis in "xyz"]
    rows = [",".join(header)]
    for frame in range(FRAMES):
        points = scale * rope_points(frame, 4)[order]
        cells = [f"{v:.6f}" for v in points.ravel()]
        if frame == 2:
            cells[3:6] = ["", "", ""]
        rows.append(",".join([f"{frame / 50:.3f}", *cells]))
    path.write_text("\n".join(rows) + "\n")
    return path


def cloud_folder(directory: Path, scale: float = 1.0) -> Path:
    """PLY and PCD files written by open3d; numbers without leading zeros."""
    import open3d as o3d

    directory.mkdir()
    for frame in range(FRAMES):
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scale * cloud_points(frame)))
        name = f"scan_{8 + frame}.{'ply' if frame % 2 else 'pcd'}"
        assert o3d.io.write_point_cloud(str(directory / name), cloud)
    (directory / "notes.txt").write_text("not a cloud")
    return directory
