"""Folders of masks that a person or another tool has made: one image a frame, rope where not 0."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np

from ropefit.errors import BadInput

SUFFIXES = {".png", ".jpg", ".jpeg"}
NUMBER = re.compile(r"([0-9]{1,9})\D*$")


class Masks:
    """Masks (H, W) bool by frame number: the last number in each file's name."""

    def __init__(self, folder: Path):
        if not folder.is_dir():
            raise BadInput(f"{folder}: no such folder of masks; give one image per frame in it")
        self.folder = folder
        self.paths: dict[int, Path] = {}
        for path in sorted(folder.iterdir()):
            match = NUMBER.search(path.stem)
            if path.suffix.lower() in SUFFIXES and match:
                frame = int(match.group(1))
                if frame in self.paths:
                    raise BadInput(
                        f"{folder}: {self.paths[frame].name} and {path.name} are both of frame "
                        f"{frame}; keep one"
                    )
                self.paths[frame] = path
        if not self.paths:
            raise BadInput(f"{folder}: no mask in it; name them by frame, such as 000012.png")

    def mask(self, frame: int, shape: tuple[int, int]) -> np.ndarray:
        """Return the mask (H, W) of a frame of that shape. Raises BadInput."""
        from PIL import Image

        path = self.paths.get(frame)
        if path is None:
            raise BadInput(f"{self.folder}: no mask of frame {frame}; add it")
        try:
            with Image.open(path, formats=["PNG", "JPEG"]) as image:
                if image.size != (shape[1], shape[0]):
                    raise BadInput(
                        f"{path}: {image.width}x{image.height} pixels, the picture has "
                        f"{shape[1]}x{shape[0]}"
                    )
                values = np.asarray(image.convert("L"))
        except BadInput:
            raise
        except Exception as error:  # PIL raises whatever a damaged file makes it meet
            raise BadInput(f"{path}: not a readable PNG or JPEG ({error})")
        return values > (127 if path.suffix.lower() != ".png" else 0)

    def sha256(self) -> str:
        """Hash of the names and contents of all masks."""
        digest = hashlib.sha256()
        for frame, path in sorted(self.paths.items()):
            try:
                digest.update(f"{frame} ".encode() + path.read_bytes())
            except OSError as error:
                raise BadInput(f"{path}: not readable ({error.strerror})")
        return digest.hexdigest()
