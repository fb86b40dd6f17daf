"""The Azure Kinect's calibration, and the colour that each pixel of its depth image has.

Brown-Conrady with six radial coefficients, as the recorder's JSON gives them: focal lengths and
centre in units of the sensor's width and height.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.errors import BadInput
from ropefit.importers.base import readable

ROUNDS = 20  # of the fixed-point iteration that takes distortion away
# Size of a depth image: how many pixels are binned into one a side, and where it is then cut from.
MODES = {
    (640, 576): (1, (192, 180)),
    (320, 288): (2, (96, 90)),
    (1024, 1024): (1, (0, 0)),
    (512, 512): (2, (0, 0)),
}
DEPTH, COLOUR = "CALIBRATION_CameraPurposeDepth", "CALIBRATION_CameraPurposePhotoVideo"


@dataclass(frozen=True)
class Lens:
    """focal (2,) and centre (2,) in units of the sensor (width, height); radial (6,); tangential
    (2,); sensor (width, height) [px]; rotation (3, 3), shift (3,) [m]: lens <- rig."""

    focal: np.ndarray
    centre: np.ndarray
    radial: np.ndarray
    tangential: np.ndarray
    sensor: tuple[int, int]
    rotation: np.ndarray
    shift: np.ndarray

    def distort(self, flat: np.ndarray) -> np.ndarray:
        """Return (..., 2) where the lens puts directions (..., 2) = (X/Z, Y/Z)."""
        x, y = flat[..., 0], flat[..., 1]
        r2 = x * x + y * y
        k1, k2, k3, k4, k5, k6 = self.radial
        p1, p2 = self.tangential
        gain = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                gain * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                gain * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ],
            axis=-1,
        )

    def pixels(self, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return focal lengths (2,) and centre (2,) [px] in an image (width, height) of this
        sensor.

        The colour sensor has 4:3; images of 16:9 are cut from it, an eighth above and below.
        """
        scale = np.array(size, dtype=float)
        offset = np.zeros(2)
        wide = abs(size[0] * 9 - size[1] * 16) < 9
        if wide and abs(self.sensor[0] * 3 - self.sensor[1] * 4) < 4:
            scale[1] = size[0] * 3 / 4
            offset[1] = (scale[1] - size[1]) / 2
        return self.focal * scale, self.centre * scale - offset - 0.5


def calibration(source: Path, data: bytes) -> dict[str, Lens]:
    """Return the two lenses of an attached calibration. Raises BadInput."""
    with readable(source, "an Azure Kinect calibration"):
        content = json.loads(data.rstrip(b"\x00").decode("utf-8"))
        cameras = {c["Purpose"]: c for c in content["CalibrationInformation"]["Cameras"]}
        lenses = {purpose: _lens(cameras[purpose]) for purpose in (DEPTH, COLOUR)}
    for lens in lenses.values():
        values = np.concatenate([lens.focal, lens.centre, lens.radial, lens.rotation.ravel()])
        if not np.isfinite(values).all() or (lens.focal <= 0).any():
            raise BadInput(f"{source}: its calibration holds no usable focal lengths")
    return lenses


def _lens(camera: dict) -> Lens:
    p = [float(v) for v in camera["Intrinsics"]["ModelParameters"]]
    # cx cy fx fy k1 .. k6 codx cody p2 p1
    turn = np.array(camera["Rt"]["Rotation"], dtype=float).reshape(3, 3)
    shift = np.array(camera["Rt"]["Translation"], dtype=float)
    sensor = (int(camera["SensorWidth"]), int(camera["SensorHeight"]))
    return Lens(
        np.array(p[2:4]), np.array(p[0:2]), np.array(p[4:10]), np.array([p[13], p[12]]), sensor,
        turn, shift,
    )  # fmt: skip


class Register:
    """Straightens depth images of one size and finds the colour of each of their pixels.

    size (W, H) and matrix fx, fy, cx, cy [px] are those of the straightened depth image.
    """

    def __init__(
        self,
        source: Path,
        known: dict[str, Lens],
        depth: tuple[int, ...],
        color: tuple[int, ...],
    ):
        self.deep, self.shot = known[DEPTH], known[COLOUR]
        self.size = (depth[1], depth[0])
        self.color_size = (color[1], color[0])
        focal, centre = self._depth_matrix(source)
        self.matrix = (float(focal[0]), float(focal[1]), float(centre[0]), float(centre[1]))
        rows, columns = np.mgrid[0 : depth[0], 0 : depth[1]]
        self.rays = (np.stack([columns, rows], axis=-1) - centre) / focal
        bent = self.deep.distort(self.rays) * focal + centre
        self.at = np.round(bent).astype(int)
        inside = (self.at >= 0).all(-1) & (self.at < self.size).all(-1)
        # Beyond the lens's circle its polynomial turns back: those pixels see nothing.
        self.inside = inside & (np.linalg.norm(self._undone(bent, focal, centre), axis=-1) < 1e-2)
        self.at = np.clip(self.at, 0, np.array(self.size) - 1)

    def __call__(self, color: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return colour (H, W, 3) uint8 and depth (H, W) uint16, both as the straightened depth
        camera sees them. Where no depth was measured the colour is that of the nearest depth."""
        from scipy.ndimage import distance_transform_edt

        straight = np.where(self.inside, depth[self.at[..., 1], self.at[..., 0]], 0)
        metres = straight.astype(float)
        if (straight == 0).any() and (straight > 0).any():
            nearest: Any = distance_transform_edt(
                straight == 0, return_distances=False, return_indices=True
            )
            metres = metres[nearest[0], nearest[1]]
        z = np.maximum(metres, 1.0) * 1e-3
        points = np.concatenate([self.rays * z[..., None], z[..., None]], axis=-1)
        turn = self.shot.rotation @ self.deep.rotation.T
        moved = points @ turn.T + (self.shot.shift - turn @ self.deep.shift)
        focal, centre = self.shot.pixels(self.color_size)
        flat = moved[..., :2] / np.maximum(moved[..., 2:], 1e-6)
        uv = np.round(self.shot.distort(flat) * focal + centre).astype(int)
        seen = (uv >= 0).all(-1) & (uv < self.color_size).all(-1) & (moved[..., 2] > 0)
        uv = np.clip(uv, 0, np.array(self.color_size) - 1)
        image = np.where(seen[..., None], color[uv[..., 1], uv[..., 0]], 0).astype(np.uint8)
        return image, np.where(seen, straight, 0).astype(np.uint16)

    def _depth_matrix(self, source: Path) -> tuple[np.ndarray, np.ndarray]:
        """Return the depth image is the sensor's, binned and cut as its mode has it."""
        if self.size not in MODES:
            sizes = ", ".join(f"{w}x{h}" for w, h in MODES)
            raise BadInput(f"{source}: depth images of {self.size}; the Kinect's are {sizes}")
        bins, cut = MODES[self.size]
        sensor = np.array(self.deep.sensor, dtype=float) / bins
        return self.deep.focal * sensor, self.deep.centre * sensor - np.array(cut) - 0.5

    def _undone(self, bent: np.ndarray, focal: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Return how far the ray that the distortion leads back to is from the ray it came from."""
        there = (bent - centre) / focal
        flat = there.copy()
        for _ in range(ROUNDS):
            flat = np.clip(flat + there - self.deep.distort(flat), -10, 10)
        return flat - self.rays
