"""ROS messages to arrays. Every size a message declares is checked against the bytes it has."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from ropefit.errors import BadInput

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
COLORS = {"rgb8": [0, 1, 2], "bgr8": [2, 1, 0], "rgba8": [0, 1, 2], "bgra8": [2, 1, 0]}
GREYS = ("mono8", "8uc1")
MOST_PIXELS = 20000
FINE = 0.00025  # m per unit of depth that came as floating-point metres; reaches 16 m


def stamp(message: Any, received: int) -> float:
    """Return seconds: the header's time, or when the message was received [ns] if it has none."""
    header = getattr(message, "header", None)
    if header is not None:
        time = header.stamp.sec + header.stamp.nanosec * 1e-9
        if time > 0:
            return float(time)
    return received * 1e-9


def cloud(message: Any) -> np.ndarray:
    """Return (N, 3) positions of a PointCloud2 in its own frame, those that are not finite
    included."""
    count = int(message.width) * int(message.height)
    step, data = int(message.point_step), np.asarray(message.data, dtype=np.uint8)
    order = ">" if message.is_bigendian else "<"
    fields = {}
    for field in message.fields:
        if field.name in ("x", "y", "z"):
            kind = TYPES.get(int(field.datatype))
            if kind is None or int(field.offset) + np.dtype(kind).itemsize > step:
                raise BadInput(f"a cloud's field {field.name} lies outside its points")
            fields[field.name] = (order + kind, int(field.offset))
    if sorted(fields) != ["x", "y", "z"]:
        raise BadInput("a cloud without the fields x, y, z")
    row = int(message.row_step) if int(message.height) > 1 else step * int(message.width)
    if row < step * int(message.width) or row * int(message.height) > data.size:
        raise BadInput(f"a cloud declares {count} points, more than its {data.size} bytes hold")
    if int(message.height) > 1:
        rows = data[: row * int(message.height)].reshape(int(message.height), row)
        data = np.ascontiguousarray(rows[:, : step * int(message.width)]).ravel()
    names = ["x", "y", "z"]
    record = np.dtype(
        {
            "names": names,
            "formats": [fields[name][0] for name in names],
            "offsets": [fields[name][1] for name in names],
            "itemsize": step,
        }
    )
    points = np.frombuffer(data.tobytes()[: count * step], record, count)
    with np.errstate(all="ignore"):
        return np.stack([points[name].astype(float) for name in names], axis=1)


def color(message: Any) -> np.ndarray:
    """Return (H, W, 3) uint8 RGB of an Image or CompressedImage."""
    if hasattr(message, "format"):
        return _decoded(message, deep=False)
    encoding = str(message.encoding).lower()
    if encoding in GREYS:
        return np.repeat(_pixels(message, "u1", 1), 3, axis=2)
    if encoding not in COLORS:
        raise BadInput(f"colour images of encoding {encoding[:40]!r}; {', '.join(COLORS)} are read")
    channels = 4 if "a8" in encoding else 3
    return np.ascontiguousarray(_pixels(message, "u1", channels)[:, :, COLORS[encoding]])


def depth(message: Any) -> tuple[np.ndarray, float]:
    """Return (H, W) uint16 of an Image or CompressedImage, and its metres per unit."""
    if hasattr(message, "format"):
        return _decoded(message, deep=True), 0.001
    encoding = str(message.encoding).lower()
    order = ">" if message.is_bigendian else "<"
    if encoding in ("16uc1", "mono16"):
        return _pixels(message, order + "u2", 1)[:, :, 0].astype(np.uint16), 0.001
    if encoding == "32fc1":
        metres = _pixels(message, order + "f4", 1)[:, :, 0].astype(float)
        known = np.isfinite(metres) & (metres > 0) & (metres < 65535 * FINE)
        return np.round(np.where(known, metres, 0.0) / FINE).astype(np.uint16), FINE
    raise BadInput(f"depth images of encoding {encoding[:40]!r}; 16UC1, mono16, 32FC1 are read")


def _pixels(message: Any, kind: str, channels: int) -> np.ndarray:
    """Return (H, W, channels) of an Image, without the padding at the end of rows."""
    width, height, step = int(message.width), int(message.height), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    wide = width * channels * np.dtype(kind).itemsize
    if not (0 < width <= MOST_PIXELS and 0 < height <= MOST_PIXELS):
        raise BadInput(f"an image of {width}x{height} pixels")
    if step < wide or step * height > data.size:
        raise BadInput(f"an image of {width}x{height} pixels has only {data.size} bytes")
    rows = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :wide])
    return rows.view(kind).reshape(height, width, channels)


def _decoded(message: Any, deep: bool) -> np.ndarray:
    from PIL import Image

    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    if deep and "compresseddepth" in str(message.format).lower().replace(" ", ""):
        data = data[12:]  # a header of three numbers before the PNG
    with Image.open(io.BytesIO(data), formats=["PNG", "JPEG"]) as image:
        if max(image.size) > MOST_PIXELS:
            raise BadInput(f"an image of {image.size[0]}x{image.size[1]} pixels")
        if deep != image.mode.startswith("I"):
            raise BadInput(
                f"a compressed image of kind {image.mode} where depth is needed"
                if deep
                else f"a colour image of kind {image.mode}"
            )
        return np.asarray(image).astype(np.uint16) if deep else np.asarray(image.convert("RGB"))


def intrinsics(message: Any) -> tuple[tuple[int, int], tuple[float, float, float, float], float]:
    """Return size (W, H), fx fy cx cy, and the largest distortion coefficient of a CameraInfo."""
    matrix = np.asarray(getattr(message, "K", None) if hasattr(message, "K") else message.k)
    bent = np.asarray(message.D if hasattr(message, "D") else message.d, dtype=float)
    matrix = matrix.astype(float).reshape(3, 3)
    if not np.isfinite(matrix).all() or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise BadInput("a CameraInfo without focal lengths")
    values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    size = (int(message.width), int(message.height))
    return size, tuple(float(v) for v in values), float(np.abs(bent).max(initial=0.0))  # type: ignore[return-value]


def pose(message: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return position (3,) [m] and quaternion (4,) w x y z of a pose or a transform."""
    inner = message
    for name in ("pose", "transform"):
        while hasattr(inner, name):
            inner = getattr(inner, name)
    place = inner.translation if hasattr(inner, "translation") else inner.position
    turn = inner.rotation if hasattr(inner, "rotation") else inner.orientation
    position = np.array([place.x, place.y, place.z], dtype=float)
    quaternion = np.array([turn.w, turn.x, turn.y, turn.z], dtype=float)
    norm = np.linalg.norm(quaternion)
    if not np.isfinite(position).all() or not np.isfinite(norm) or abs(norm - 1) > 0.01:
        raise BadInput("a pose that is not finite or has no unit quaternion")
    return position, quaternion / norm
