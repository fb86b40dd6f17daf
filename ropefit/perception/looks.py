"""How the rope looks, learned from one picture and looked up in the others of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

BITS = 5  # of each channel
LIKELIER = 3.0  # times: a colour is the rope's where it is that much commoner on it than beside it
LEAST = 2e-4  # share of the rope that a colour must make up


@dataclass(frozen=True)
class Looks:
    """table (2^15,) bool: is this colour the rope's; width [px] and score of the rope learned
    from."""

    table: np.ndarray
    width: float
    score: float

    def mask(self, color: np.ndarray) -> np.ndarray:
        """(H, W) bool of an image (H, W, 3) uint8 RGB."""
        return self.table[_index(cv2.GaussianBlur(color, (3, 3), 0))]


def learn(
    color: np.ndarray, mask: np.ndarray, path: np.ndarray, width: float, score: float
) -> Looks:
    """Looks of the rope along path (P, 2) in mask (H, W) of an image (H, W, 3) uint8 RGB."""
    along = np.zeros(mask.shape, np.uint8)
    pixels = np.round(path * 16).astype(np.int32)[:, None]
    cv2.polylines(along, [pixels], False, 1, max(round(1.2 * width), 1), shift=4)
    rope = mask & (along > 0)
    index = _index(cv2.GaussianBlur(color, (3, 3), 0))
    # What is near the rope's colour but just outside its mask may be rope: it counts for neither.
    near = cv2.dilate(rope.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    on, off = _density(index[rope]), _density(index[~near & ~mask])
    return Looks((on > LIKELIER * off) & (on > LEAST / 10), width, score)


def _index(color: np.ndarray) -> np.ndarray:
    small = (color >> (8 - BITS)).astype(np.uint16)
    return (small[..., 0] << (2 * BITS)) | (small[..., 1] << BITS) | small[..., 2]


def _density(index: np.ndarray) -> np.ndarray:
    """(2^15,) smoothed share of each colour."""
    count = np.bincount(index.ravel(), minlength=1 << (3 * BITS)).astype(np.float32)
    cube = gaussian_filter(count.reshape((1 << BITS,) * 3), 1.0, mode="nearest")
    return cube.ravel() / max(float(cube.sum()), 1.0)
