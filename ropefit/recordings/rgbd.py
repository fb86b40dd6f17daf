"""RGB-D folders: colour PNG or JPEG and 16-bit depth PNG of one calibrated camera."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest
from ropefit.recordings.patterns import list_frames
from ropefit.recordings.sources import Sight, Source

FORMATS = ["PNG", "JPEG"]
ORIENTATION, SIDEWAYS = 0x0112, (5, 6, 7, 8)  # the tag of how the camera was held; a quarter turn


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
            raise BadInput(
                f"{directory}: frame {missing[0]} has a colour image but no depth image; add it or "
                "remove the colour image"
            )
        self._check_intrinsics()

    def sight(self, frame: int) -> Sight:
        color = self._image(self.color[frame], "RGB").astype(np.uint8)
        depth = None
        if self.depth:
            raw = self._image(self.depth[frame], "I;16")
            depth = raw.astype(float) * self.settings.depth_scale
        return Sight(color=color, depth=depth)

    def _check_intrinsics(self) -> None:
        """Refuse intrinsics that cannot be those of pictures of the given size. Raises BadInput."""
        k = self.settings.intrinsics
        for name, value, size in (("cx", k.cx, k.width), ("cy", k.cy, k.height)):
            if not 0.25 * size <= value <= 0.75 * size:
                raise BadInput(
                    f"{self.directory}: {name} = {value:g} px is far from the middle of pictures "
                    f"of {k.width}x{k.height}: intrinsics of another resolution? scale fx, fy, cx "
                    "and cy with the pictures"
                )

    def _turned(self, image: Any, want: tuple[int, int]) -> Any:
        """Return the picture as its orientation tag says it was held, if that is what `want`
        means."""
        from PIL import ImageOps

        if not _sideways(image):
            return image
        upright = ImageOps.exif_transpose(image)
        return upright if upright.size == want else image

    def _image(self, path: Path, mode: Literal["RGB", "I;16"]) -> np.ndarray:
        """Return (H, W[, 3]) pixels; size and checksums are checked before anything is decoded."""
        from PIL import Image

        want = (self.settings.intrinsics.width, self.settings.intrinsics.height)
        try:
            with (
                warnings.catch_warnings(action="ignore"),
                Image.open(path, formats=FORMATS) as image,
            ):
                size = image.size
                if _sideways(image):
                    size = want if want in (size, size[::-1]) else size[::-1]
                if size == want:
                    image.verify()
        except FileNotFoundError:
            raise BadInput(f"{path}: no such file")
        except Exception as error:  # PIL raises whatever a damaged file makes it meet
            raise BadInput(f"{path}: not a readable PNG or JPEG ({error})")
        if size != want:
            found = f"{path}: {size[0]}x{size[1]} pixels, intrinsics say {want[0]}x{want[1]}"
            if size == want[::-1]:
                raise BadInput(f"{found}: the picture is rotated; turn it, or give its intrinsics")
            raise BadInput(
                f"{found}: intrinsics of another resolution; scale width, height, fx, fy, cx and cy"
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
                return np.asarray(image if deep else self._turned(image, want).convert("RGB"))
        except Exception as error:
            raise BadInput(f"{path}: truncated or damaged image ({error})")

    def files(self) -> list[Path]:
        return [*self.color.values(), *self.depth.values()]


def _sideways(image: Any) -> bool:
    """Return whether a photograph says that it is stored a quarter turn from how it was taken."""
    return image.format == "JPEG" and image.getexif().get(ORIENTATION, 1) in SIDEWAYS
