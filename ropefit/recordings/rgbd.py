"""RGB-D folders: colour PNG or JPEG and 16-bit depth PNG of one calibrated camera."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Literal

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest
from ropefit.recordings.patterns import list_frames
from ropefit.recordings.sources import Sight, Source

FORMATS = ["PNG", "JPEG"]


class Rgbd(Source):
    """Colour (H, W, 3) uint8 and depth (H, W) [m] of each frame; 0 = no depth."""

    table = "rgbd"

    def __init__(self, directory: Path, manifest: Manifest):
        super().__init__(directory, manifest)
        assert manifest.rgbd is not None
        self.settings = manifest.rgbd
        self.color = list_frames(directory, manifest.rgbd.color, "rgbd.color")
        self.depth = (
            list_frames(directory, manifest.rgbd.depth, "rgbd.depth") if manifest.rgbd.depth else {}
        )
        self.frames = list(self.color)
        missing = [frame for frame in self.color if self.depth and frame not in self.depth]
        if missing:
            raise BadInput(f"{directory}: frame {missing[0]} has a colour image but no depth image")

    def sight(self, frame: int) -> Sight:
        color = self._image(self.color[frame], "RGB").astype(np.uint8)
        depth = None
        if self.depth:
            raw = self._image(self.depth[frame], "I;16")
            depth = raw.astype(float) * self.settings.depth_scale
        return Sight(color=color, depth=depth)

    def _image(self, path: Path, mode: Literal["RGB", "I;16"]) -> np.ndarray:
        """(H, W[, 3]) pixels; size and checksums are checked before anything is decoded."""
        from PIL import Image

        want = (self.settings.intrinsics.width, self.settings.intrinsics.height)
        try:
            with (
                warnings.catch_warnings(action="ignore"),
                Image.open(path, formats=FORMATS) as image,
            ):
                if image.size == want:
                    image.verify()
        except FileNotFoundError:
            raise BadInput(f"{path}: no such file")
        except Exception as error:  # PIL raises whatever a damaged file makes it meet
            raise BadInput(f"{path}: not a readable PNG or JPEG ({error})")
        if image.size != want:
            raise BadInput(
                f"{path}: {image.width}x{image.height} pixels, intrinsics say {want[0]}x{want[1]}"
            )
        deep = image.mode.startswith("I")  # 16 bits, one channel
        if deep != (mode == "I;16"):
            need = "one channel of 16 bits" if mode == "I;16" else "8 bits a channel"
            raise BadInput(f"{path}: pixels of kind {image.mode}; {need} needed")
        try:
            with (
                warnings.catch_warnings(action="ignore"),
                Image.open(path, formats=FORMATS) as image,
            ):
                return np.asarray(image if deep else image.convert("RGB"))
        except Exception as error:
            raise BadInput(f"{path}: truncated or damaged image ({error})")

    def files(self) -> list[Path]:
        return [*self.color.values(), *self.depth.values()]
