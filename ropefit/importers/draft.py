"""A recording in the making: frames are put in, files of the recording format come out."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.importers.plausible import check_depth, check_points

Position = np.ndarray


@dataclass(frozen=True)
class About:
    """What the user says of the rope and the set-up; None = not known. SI units."""

    name: str
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    length: float | None = None
    diameter: float | None = None
    mass: float | None = None


@dataclass
class Draft:
    """Writes into `directory`; nothing is a recording before `finish`.

    frames counts what was put in; notes are sentences for the user.
    """

    directory: Path
    about: About
    progress: Callable[[float, str], None] = lambda share, text: None
    notes: list[str] = field(default_factory=list)
    frames: int = 0
    _tables: list[str] = field(default_factory=list)
    _ends: list[str] = field(default_factory=list)
    _clamped: bool = False
    _held: str = ""

    def note(self, sentence: str) -> None:
        """Something the user should know; said once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def cloud(self, frame: int, points: np.ndarray, source: Path) -> None:
        """Points (N, 3) [m] of a frame; those that are not finite are dropped."""
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) == 0:
            self.note(f"frame {frame} has no finite points and is left out")
            return
        check_points(source, frame, points, self.about.length)
        folder = self.directory / "clouds"
        folder.mkdir(exist_ok=True)
        header = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
            "property float x\nproperty float y\nproperty float z\nend_header\n"
        )
        path = folder / f"{frame:06d}.ply"
        path.write_bytes(header.encode() + points.astype("<f4").tobytes())
        self.frames += 1

    def clouds_table(self, viewpoint: np.ndarray | None) -> None:
        """[clouds], with the camera's position (3,) [m] if known."""
        lines = ["[clouds]", 'pattern = "clouds/{frame:06d}.ply"']
        if viewpoint is not None:
            lines.append(f"viewpoint = {_list(viewpoint)}")
        self._tables.append("\n".join(lines))

    def images(
        self,
        frame: int,
        color: np.ndarray,
        depth: np.ndarray | None,
        depth_scale: float,
        source: Path,
    ) -> None:
        """Colour (H, W, 3) uint8 RGB and depth (H, W) uint16 of a frame."""
        from PIL import Image

        for name, image in (("color", color), ("depth", depth)):
            if image is not None:
                (self.directory / name).mkdir(exist_ok=True)
                Image.fromarray(np.ascontiguousarray(image)).save(
                    self.directory / name / f"{frame:06d}.png", compress_level=1
                )
        if depth is not None:
            middle = check_depth(source, frame, depth, depth_scale)
            if self.frames == 0 and middle is not None:
                self.note(
                    f"half of the first depth image lies nearer than {middle:.3g} m; if that is "
                    f"wrong, give --set depth_scale=... (now {depth_scale:g} m per unit)"
                )
        self.frames += 1

    def rgbd_table(
        self,
        size: tuple[int, int],
        matrix: tuple[float, float, float, float],
        pose: np.ndarray | None,
        depth_scale: float | None,
    ) -> None:
        """[rgbd]: size (W, H), fx fy cx cy, pose (4, 4) recording <- camera, m per depth unit."""
        fx, fy, cx, cy = matrix
        lines = ["[rgbd]", 'color = "color/{frame:06d}.png"']
        if depth_scale is not None:
            lines += ['depth = "depth/{frame:06d}.png"', f"depth_scale = {depth_scale:.9g}"]
        lines.append(
            f"intrinsics = {{ width = {size[0]}, height = {size[1]}, fx = {fx!r}, fy = {fy!r}, "
            f"cx = {cx!r}, cy = {cy!r} }}"
        )
        if pose is not None:
            rows = ", ".join(_list(row) for row in pose)
            lines.append(f"camera_pose = [{rows}]")
        self._tables.append("\n".join(lines))

    def markers(
        self, positions: np.ndarray, time: np.ndarray, source: Path, held: str | None
    ) -> None:
        """Positions (F, M, 3) [m], NaN = not seen; time (F,) [s]; held: `[[0], [12]]` or None."""
        for frame, points in enumerate(positions):
            check_points(source, frame, points[np.isfinite(points).all(axis=1)], self.about.length)
        np.savez(self.directory / "markers.npz", positions=positions, time=time)
        self._tables.append('[markers]\nfile = "markers.npz"')
        self._held = f"markers = {held}" if held else ""
        self.frames += len(positions)

    def end(
        self,
        frame: int,
        time: float,
        end: int,
        position: np.ndarray,
        orientation: np.ndarray | None,
    ) -> None:
        """Pose of an end in a frame: position (3,) [m]; orientation (4,) w x y z, None: pinned."""
        cells = [str(frame), f"{time:.6f}", str(end), *(f"{v:.9g}" for v in position)]
        if orientation is not None:
            self._clamped = True
            cells += [f"{v:.12g}" for v in orientation]
        self._ends.append(",".join(cells))

    def finish(self) -> None:
        """Write recording.toml and ends.csv."""
        if self.frames == 0:
            raise BadInput("no frame was found in the source; see what it holds with --list")
        about = self.about
        lines = [
            'format = "ropefit-recording/1"',
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


def _list(values: np.ndarray) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _quoted(text: str) -> str:
    """A TOML string; JSON's escapes are TOML's but for DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
