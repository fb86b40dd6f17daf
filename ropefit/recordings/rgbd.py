"""RGB-D folders: colour PNG or JPEG and 16-bit depth PNG of one calibrated camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput
from ropefit.recordings.manifest import Manifest
from ropefit.recordings.patterns import list_frames
from ropefit.recordings.sources import Sight, Source


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
        import cv2

        color = self._image(self.color[frame], cv2.IMREAD_COLOR, np.uint8)
        depth = None
        if self.depth:
            raw = self._image(self.depth[frame], cv2.IMREAD_UNCHANGED, np.uint16)
            depth = raw.astype(float) * self.settings.depth_scale
        return Sight(color=cv2.cvtColor(color, cv2.COLOR_BGR2RGB), depth=depth)

    def _image(self, path: Path, mode: int, dtype: type) -> np.ndarray:
        import cv2

        want = (self.settings.intrinsics.height, self.settings.intrinsics.width)
        _check_size(path, want)
        try:
            image = cv2.imdecode(np.fromfile(path, np.uint8), mode)
        except (OSError, cv2.error) as error:
            raise BadInput(f"{path}: not a readable image ({error})")
        if image is None:
            raise BadInput(f"{path}: not a readable image; write it anew")
        if image.dtype != dtype or (dtype is np.uint16 and image.ndim != 2):
            raise BadInput(f"{path}: {image.dtype} {image.shape}; depth is one channel of uint16")
        if image.shape[:2] != want:
            raise BadInput(
                f"{path}: {image.shape[1]}x{image.shape[0]} pixels, intrinsics say "
                f"{want[1]}x{want[0]}"
            )
        return image

    def files(self) -> list[Path]:
        return [*self.color.values(), *self.depth.values()]


def _check_size(path: Path, want: tuple[int, int]) -> None:
    """Refuse an image whose header declares other dimensions, before anything is decoded."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=["PNG", "JPEG"]) as image:
            width, height = image.size
    except FileNotFoundError:
        raise BadInput(f"{path}: no such file")
    except (OSError, UnidentifiedImageError, ValueError, Image.DecompressionBombError) as error:
        raise BadInput(f"{path}: not a readable PNG or JPEG ({error})")
    if (height, width) != want:
        raise BadInput(f"{path}: {width}x{height} pixels, intrinsics say {want[1]}x{want[0]}")
