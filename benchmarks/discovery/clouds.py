"""What a depth camera makes of a rope: one-sided clouds, noise, outliers, gaps; and the files."""

from __future__ import annotations

import csv
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """A depth camera."""

    viewpoint: tuple[float, float, float] = (0.1, -1.4, 0.5)  # m
    noise: float = 0.001  # m, sd along the ray
    lateral: float = 0.0002  # m, sd across it
    points: int = 300  # per frame, about
    outliers: float = 0.01  # share
    stray: float = 0.03  # m, sd per axis of an outlier
    occluded: float = 0.15  # largest share of the rope that is hidden in a frame


@dataclass(frozen=True)
class CameraErrors:
    """How wrongly the camera sees: what a calibration leaves over, or a concealed mistake.

    Points p become v + (1 + scale) R (p - v) + translation, then `depth` further along their ray;
    `flat` is the lost share of the offset from the vertical plane through the ends; with
    `ends_too` the scale is that of the recorded ends as well.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad, rotation vector about v
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m
    scale: float = 0.0
    gain: float = 0.0  # distance along rays: factor less one
    depth: float = 0.0  # m
    flat: float = 0.0
    ends_too: bool = False


def surface(
    nodes: Array, tangents: Array, s: Array, radius: float, sensor: Sensor, rng: np.random.Generator
) -> Array:
    """Return the visible surface points (m, 3) [m] of a rope through `nodes` (n, 3) [m]."""
    curve = CubicHermiteSpline(s, nodes, tangents)
    view = np.asarray(sensor.viewpoint)
    at = rng.uniform(s[0], s[-1], 3 * sensor.points)
    centre, tangent = curve(at), curve(at, 1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    back = view - centre
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    front = back - (back * tangent).sum(1, keepdims=True) * tangent
    sine = np.linalg.norm(front, axis=1, keepdims=True)  # foreshortened rope has fewer pixels
    seen = rng.random(len(at)) < sine[:, 0] * 0.5
    hidden, room = np.zeros(len(at), bool), rng.uniform(0, sensor.occluded) * s[-1]
    while room > 0.01 * s[-1]:
        width = min(room, rng.uniform(0.02, 0.10) * s[-1])
        start = rng.uniform(s[0], s[-1] - width)
        hidden |= (at > start) & (at < start + width)
        room -= width
    keep = seen & ~hidden
    front, side = front / sine, np.cross(tangent, front / sine)
    across = rng.uniform(-0.97, 0.97, len(at))[:, None]
    points = centre + radius * (np.sqrt(1 - across**2) * front + across * side)
    return points[keep][: sensor.points]


def observe(
    points: Array, ends: Array, camera: CameraErrors, sensor: Sensor, rng: np.random.Generator
) -> Array:
    """Return the points (m, 3) [m] that the camera reports; `ends` (2, 3) [m] of the rope."""
    view = np.asarray(sensor.viewpoint)
    if camera.flat:
        normal = np.cross(ends[1] - ends[0], [0.0, 0.0, 1.0])
        normal /= np.linalg.norm(normal)
        points = points - camera.flat * ((points - ends[0]) @ normal)[:, None] * normal
    points = mistaken(points, camera, view)
    ray = points - view
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    lateral = sensor.lateral * rng.standard_normal(points.shape)
    lateral -= (lateral * ray).sum(1, keepdims=True) * ray
    out = points + lateral + sensor.noise * rng.standard_normal((len(points), 1)) * ray
    stray = rng.random(len(out)) < sensor.outliers
    out[stray] += sensor.stray * rng.standard_normal((int(stray.sum()), 3))
    return out[rng.permutation(len(out))]


def mistaken(points: Array, camera: CameraErrors, view: Array) -> Array:
    """Return where a camera at `view` (3,) [m] with these errors sees points (…, 3) [m]."""
    turn = Rotation.from_rotvec(camera.rotation).as_matrix()
    away = (1 + camera.scale) * (1 + camera.gain) * (points - view) @ turn.T
    ray = away / np.linalg.norm(away, axis=-1, keepdims=True)
    return view + away + camera.depth * ray + np.asarray(camera.translation)


@dataclass(frozen=True)
class Metadata:
    """What the recording says; arrays over T frames."""

    name: str
    gravity: tuple[float, float, float]  # m/s²
    length: float  # m
    diameter: float  # m
    mass: float  # kg
    ends: Array  # (T, 2, 3) m
    orientations: Array | None  # (T, 2, 4) w, x, y, z; None: pinned
    interval: float  # s


def write(folder: Path, told: Metadata, clouds: list[Array], sensor: Sensor) -> None:
    """Write the recording's directory anew."""
    if folder.exists():
        shutil.rmtree(folder)
    (folder / "clouds").mkdir(parents=True)
    for frame, points in enumerate(clouds):
        head = (
            "ply\nformat binary_little_endian 1.0\n"
            f"element vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\nend_header\n"
        )
        data = head.encode() + points.astype("<f4").tobytes()
        (folder / "clouds" / f"{frame:06d}.ply").write_bytes(data)
    columns = ["frame", "time", "end", "x", "y", "z"]
    if told.orientations is not None:
        columns += ["qw", "qx", "qy", "qz"]
    with (folder / "ends.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for frame, pair in enumerate(told.ends):
            for end, position in enumerate(pair):
                row = [f"{value:.6f}" for value in position]
                if told.orientations is not None:
                    row += [f"{value:.7f}" for value in told.orientations[frame, end]]
                writer.writerow([frame, f"{frame * told.interval:.3f}", end, *row])
    gravity = ", ".join(f"{value:.6g}" for value in told.gravity)
    view = ", ".join(f"{value:.6g}" for value in sensor.viewpoint)
    (folder / "recording.toml").write_text(
        f"""format = "ropefit-recording/1"
name = "{told.name}"
gravity = [{gravity}]

[rope]
length = {told.length:.6g}
diameter = {told.diameter:.6g}
mass = {told.mass:.6g}

[ends]
file = "ends.csv"

[clouds]
pattern = "clouds/{{frame:06d}}.ply"
viewpoint = [{view}]
"""
    )
