"""The files of a recording (docs/recording-format.md), as every reader here takes them."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import FORMAT

CLOUDS = "clouds/{frame:06d}.ply"
COLOR, DEPTH = "color/{frame:06d}.png", "depth/{frame:06d}.png"


@dataclass(frozen=True)
class About:
    """What is known of the rope and the set-up; None = not known. SI units."""

    name: str
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    length: float | None = None
    diameter: float | None = None
    mass: float | None = None


@dataclass
class RecordingWriter:
    """Writes into `directory`, which exists; nothing is a recording before `finish`."""

    directory: Path
    about: About
    _tables: list[str] = field(default_factory=list, init=False)
    _ends: list[str] = field(default_factory=list, init=False)
    _clamped: bool = field(default=False, init=False)
    _held: str = field(default="", init=False)

    def write_cloud(self, frame: int, points: np.ndarray) -> None:
        """Write the points (N, 3) [m] of a frame as a binary PLY file of 32-bit numbers."""
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\nend_header\n"
        )
        path = self._path(CLOUDS, frame)
        path.write_bytes(header.encode() + points.astype("<f4").tobytes())

    def clouds_table(self, viewpoint: np.ndarray | None) -> None:
        """Add [clouds], with the camera's position (3,) [m] if known."""
        lines = ["[clouds]", f'pattern = "{CLOUDS}"']
        if viewpoint is not None:
            lines.append(f"viewpoint = {_list(viewpoint)}")
        self._tables.append("\n".join(lines))

    def write_images(self, frame: int, color: np.ndarray, depth: np.ndarray | None) -> None:
        """Write colour (H, W, 3) uint8 RGB and depth (H, W) uint16 of a frame as PNG."""
        from PIL import Image

        for pattern, image in ((COLOR, color), (DEPTH, depth)):
            if image is not None:
                pixels = Image.fromarray(np.ascontiguousarray(image))
                pixels.save(self._path(pattern, frame), compress_level=1)

    def rgbd_table(
        self,
        size: tuple[int, int],
        matrix: tuple[float, float, float, float],
        pose: np.ndarray | None,
        depth_scale: float | None,
    ) -> None:
        """Add [rgbd]: size (W, H) and fx fy cx cy [px]; pose (4, 4) recording <- camera.

        depth_scale: metres per unit of depth, None without depth.
        """
        fx, fy, cx, cy = matrix
        lines = ["[rgbd]", f'color = "{COLOR}"']
        if depth_scale is not None:
            lines += [f'depth = "{DEPTH}"', f"depth_scale = {depth_scale:.9g}"]
        lines.append(
            f"intrinsics = {{ width = {size[0]}, height = {size[1]}, fx = {fx!r}, fy = {fy!r}, "
            f"cx = {cx!r}, cy = {cy!r} }}"
        )
        if pose is not None:
            rows = ", ".join(_list(row) for row in pose)
            lines.append(f"camera_pose = [{rows}]")
        self._tables.append("\n".join(lines))

    def write_markers(
        self, positions: np.ndarray, time: np.ndarray | None, held: str | None
    ) -> None:
        """Write markers.npz: positions (F, M, 3) [m], NaN = not seen; time (F,) [s], if known.

        held: which markers the ends hold, `[[0], [12]]`, or None.
        """
        arrays = {"positions": positions} | ({} if time is None else {"time": time})
        np.savez(self.directory / "markers.npz", **arrays)  # type: ignore[arg-type]
        self._tables.append('[markers]\nfile = "markers.npz"')
        self._held = f"markers = {held}" if held else ""

    def write_markers_text(
        self, positions: np.ndarray, time: np.ndarray, arc_length: np.ndarray
    ) -> None:
        """Write markers.csv: positions (F, M, 3) [m], NaN = not seen; time (F,) [s]; arc_length
        (M,) [m]."""
        rows = ["frame,time,marker,x,y,z"]
        for frame, points in enumerate(positions):
            for marker, point in enumerate(points):
                rows.append(f"{frame},{_exact(time[frame])},{marker},{_position(point)}")
        (self.directory / "markers.csv").write_text("\n".join(rows) + "\n")
        table = f'[markers]\nfile = "markers.csv"\narc_length = {_list(arc_length)}'
        self._tables.append(table)

    def end(
        self,
        frame: int,
        time: float,
        end: int,
        position: np.ndarray,
        orientation: np.ndarray | None,
    ) -> None:
        """Add the pose of an end in a frame: position (3,) [m]; orientation (4,) w x y z, None:
        pinned."""
        row = f"{frame},{_exact(time)},{end},{_position(position)}"
        if orientation is not None:
            self._clamped = True
            row += "".join(f",{v:.12g}" for v in orientation)
        self._ends.append(row)

    def ends_of(self, table: Path) -> None:
        """Take the poses of the ends from a table as ends.csv is."""
        if not table.is_file():
            raise BadInput(f"{table}: no such file; correct its name")
        shutil.copyfile(table, self.directory / "ends.csv")
        self._held = 'file = "ends.csv"'

    def finish(self) -> None:
        """Write recording.toml and ends.csv."""
        about = self.about
        lines = [
            f'format = "{FORMAT}"',
            f"name = {_quoted(about.name)}",
            f"gravity = {_list(np.array(about.gravity))}",
        ]
        known = [
            f"{key} = {value!r}"
            for key in ("length", "diameter", "mass")
            if (value := getattr(about, key)) is not None
        ]
        tables = ["[rope]\n" + "\n".join(known)] if known else []
        if self._ends:
            width = 10 if self._clamped else 6
            header = "frame,time,end,x,y,z" + (",qw,qx,qy,qz" if self._clamped else "")
            rows = [row + "," * (width - 1 - row.count(",")) for row in self._ends]
            (self.directory / "ends.csv").write_text("\n".join([header, *rows]) + "\n")
            tables.append('[ends]\nfile = "ends.csv"')
        elif self._held:
            tables.append("[ends]\n" + self._held)
        text = "\n\n".join(["\n".join(lines), *tables, *self._tables]) + "\n"
        (self.directory / "recording.toml").write_text(text, encoding="utf-8")

    def _path(self, pattern: str, frame: int) -> Path:
        path = self.directory / pattern.format(frame=frame)
        path.parent.mkdir(exist_ok=True)
        return path


def _exact(value: float) -> str:
    return repr(float(value))


def _position(values: np.ndarray) -> str:
    return ",".join(f"{value:.9g}" for value in values)


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _quoted(text: str) -> str:
    """Return a TOML string; JSON's escapes are TOML's but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
