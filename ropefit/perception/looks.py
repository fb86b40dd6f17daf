"""How the rope looks, learned from one picture and looked up in the others of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from ropefit.perception.cues import NO_DEPTH

BITS = 5  # of each channel
BLUR = 0.7  # bins by which colours seen speak for those beside them
LIKELIER = 2.0  # times: a pixel is the rope's where what it shows is that much commoner on it
# Shares (on the rope, beside it) that what was never seen has: of colours more beside the rope,
# where there are more things; of distances the same, as depth cameras err at the edges of things.
RARE, UNSURE = (2e-5, 4e-4), (0.05, 0.05)
BLOB = 2.5  # widths: wider than two stretches side by side
# How far a pixel stands before its surroundings [mm]: bins of it, the last of them for no depth.
STEPS = np.array([0, 6, 15, 30, 60, 120, 250, 500, 1000, NO_DEPTH])


@dataclass(frozen=True)
class Looks:
    """colour (2^15,) and near (2^16,): logarithm of how many times commoner a colour, a distance
    before the surroundings [mm], is on the rope than beside it (near is None without depth);
    width [px] and score of the rope learned from."""

    colour: np.ndarray
    near: np.ndarray | None
    width: float
    score: float

    def mask(self, color: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """Return (H, W) bool of an image (H, W, 3) uint8 RGB and its nearness (H, W) [mm] (see
        cues)."""
        likely = self.colour[_index(cv2.GaussianBlur(color, (3, 3), 0))]
        if near is not None and self.near is not None:
            likely += self.near[near]
        return without_blobs(likely > np.float32(np.log(LIKELIER)), self.width)


def learn(
    color: np.ndarray,
    near: np.ndarray | None,
    mask: np.ndarray,
    path: np.ndarray,
    width: float,
    score: float,
) -> Looks:
    """Return looks of the rope along path (P, 2) in mask (H, W) of an image (H, W, 3) uint8 RGB and
    its nearness (H, W) [mm]."""
    along = np.zeros(mask.shape, np.uint8)
    pixels = np.round(path * 16).astype(np.int32)[:, None]
    cv2.polylines(along, [pixels], False, 1, max(round(1.2 * width), 1), shift=4)
    rope = mask & (along > 0)
    index = _index(cv2.GaussianBlur(color, (3, 3), 0))
    # What is near the rope's colour but just outside its mask may be rope: it counts for neither.
    beside = cv2.dilate(rope.astype(np.uint8), np.ones((5, 5), np.uint8)) == 0
    beside &= ~mask
    colour = _log_ratio(_density(index[rope]), _density(index[beside]), RARE)
    if near is None:
        return Looks(colour, None, width, score)
    on, off = (np.histogram(near[part], [*STEPS, NO_DEPTH + 1])[0] for part in (rope, beside))
    steps = _log_ratio(on / max(on.sum(), 1), off / max(off.sum(), 1), UNSURE)
    return Looks(colour, np.repeat(steps, np.diff([*STEPS, NO_DEPTH + 1])), width, score)


def without_blobs(mask: np.ndarray, width: float) -> np.ndarray:
    """Return a mask (H, W) bool less what is much wider than a rope of `width` [px]."""
    part = mask.astype(np.uint8)
    core = cv2.erode(part, _disc(BLOB * width))
    if not core.any():
        return mask
    return mask & (cv2.dilate(core, _disc(BLOB * width + 3)) == 0)


def _disc(across: float) -> np.ndarray:
    size = 2 * round(across / 2) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))


def _log_ratio(on: np.ndarray, off: np.ndarray, rare: tuple[float, float]) -> np.ndarray:
    return np.log((on + rare[0]) / (off + rare[1])).astype(np.float32)


def _index(color: np.ndarray) -> np.ndarray:
    small = (color >> (8 - BITS)).astype(np.uint16)
    return (small[..., 0] << (2 * BITS)) | (small[..., 1] << BITS) | small[..., 2]


def _density(index: np.ndarray) -> np.ndarray:
    """Return (2^15,) smoothed share of each colour."""
    count = np.bincount(index.ravel(), minlength=1 << (3 * BITS)).astype(np.float32)
    cube = gaussian_filter(count.reshape((1 << BITS,) * 3), BLUR, mode="nearest")
    return cube.ravel() / max(float(cube.sum()), 1.0)
