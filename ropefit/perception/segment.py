"""Which pixels are rope: of all colours in the picture, the one whose region is long and thin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ropefit.perception.skeleton import centred, skeleton_path
from ropefit.perception.trace import FrameRejected

COLOURS = 8
LEAST_PATH = 30  # px
ROPE_ASPECT = 40  # a region this many times longer than wide is thin enough to be rope


@dataclass(frozen=True)
class Segmentation:
    """mask (H, W) bool; path (P, 2) ordered skeleton pixels (u, v); width [px]; score (higher =
    ropier)."""

    mask: np.ndarray
    path: np.ndarray
    width: float
    score: float


def segment_rope(color: np.ndarray, ends: np.ndarray) -> Segmentation:
    """Find the rope in an image (H, W, 3) uint8 RGB. ends (2, 2) [px], NaN where unknown.

    Colours are clustered in Lab with more weight on hue than on lightness (shading); each cluster's
    region is thinned, and the longest, thinnest one that starts near the known ends wins. Raises
    FrameRejected.
    """
    lab = cv2.cvtColor(cv2.GaussianBlur(color, (0, 0), 1.0), cv2.COLOR_RGB2LAB).astype(np.float32)
    lab[..., 0] *= 0.35
    found = [
        candidate
        for label in _clusters(lab)
        if (candidate := _candidate(label, lab, ends)) is not None
    ]
    if not found:
        raise FrameRejected("no long thin region of one colour in the image")
    best = max(found, key=lambda item: item.score)
    return replace(best, path=centred(best.path, best.mask, best.width))


def _clusters(lab: np.ndarray) -> list[np.ndarray]:
    """Masks (H, W) bool of the main colours and of small but vivid ones."""
    flat = lab.reshape(-1, 3)
    chroma = np.linalg.norm(flat[:, 1:] - np.median(flat[:, 1:], axis=0), axis=1)
    # A rope is a percent of the picture: sample vivid pixels as often as common ones.
    rng = np.random.default_rng(0)
    common = rng.choice(len(flat), min(4000, len(flat)), replace=False)
    vivid = np.argsort(chroma)[-max(len(flat) // 50, 100) :]
    sample = flat[np.concatenate([common, rng.choice(vivid, min(4000, len(vivid)), False)])]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.5)
    cv2.setRNGSeed(0)
    _, _, centres = cv2.kmeans(sample, COLOURS, None, criteria, 2, cv2.KMEANS_PP_CENTERS)  # type: ignore[call-overload]
    # Of |x - c|² the part |x|² is the same for every centre.
    distance = (centres**2).sum(axis=1) - 2 * flat @ centres.T
    label = distance.argmin(axis=1).reshape(lab.shape[:2])
    masks = [label == k for k in range(len(centres))]
    # Neighbouring colours may be light and shade of one rope: try pairs too.
    for a in range(len(centres)):
        for b in range(a + 1, len(centres)):
            if np.linalg.norm(centres[a] - centres[b]) < 45:
                masks.append(masks[a] | masks[b])
    return masks


def _candidate(mask: np.ndarray, lab: np.ndarray, ends: np.ndarray) -> Segmentation | None:
    image = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, label, stats, _ = cv2.connectedComponentsWithStats(image, connectivity=8)
    area = stats[1:, cv2.CC_STAT_AREA]
    extent = np.hypot(stats[1:, cv2.CC_STAT_WIDTH], stats[1:, cv2.CC_STAT_HEIGHT])
    # Long for its area; specks and blots are not rope.
    keep = 1 + np.flatnonzero((extent >= LEAST_PATH / 2) & (area < 0.35 * extent**2))
    if count < 2 or keep.size == 0 or area[keep - 1].sum() > 0.2 * mask.size:
        return None
    rope = np.isin(label, keep)
    path = skeleton_path(rope, ends)
    if path is None or len(path) < LEAST_PATH:
        return None
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    inside = cv2.distanceTransform(rope.astype(np.uint8), cv2.DIST_L2, 5)
    rows, columns = np.round(path[:, 1]).astype(int), np.round(path[:, 0]).astype(int)
    radius = inside[rows, columns]
    on = radius > 0
    if on.mean() < 0.3:
        return None
    width = 2 * float(np.median(radius[on]))
    covered = rope.sum() / (length * width + 1)  # 1 when the region is the path and nothing else
    evenness = float(np.median(radius[on]) / (radius[on].std() + np.median(radius[on])))
    tidy = min(covered, 1 / max(covered, 1e-9))
    near = 1.0
    for end, tip in zip(ends, path[[0, -1]], strict=True):
        if np.isfinite(end).all():
            near *= np.exp(-np.linalg.norm(end - tip) / (0.15 * np.hypot(*mask.shape)))
    # Thinner than a rope need be is no merit: the seam where rope and background mix, and the
    # shaded side of the rope, are thinner than the rope. They are less distinct, so that counts
    # twice.
    thin = min(1.0, length / (ROPE_ASPECT * max(width, 1.0)))
    score = length * thin * on.mean() ** 2 * evenness * tidy * near
    score *= _contrast(rope, lab, width) ** 2
    return Segmentation(rope, path, width, float(score))


def _contrast(rope: np.ndarray, lab: np.ndarray, width: float) -> float:
    """Colour distance between a region and what lies a little beside it."""
    away = cv2.distanceTransform((~rope).astype(np.uint8), cv2.DIST_L2, 3)
    beside = (away > width + 2) & (away < 3 * width + 4)
    if not beside.any():
        return 0.0
    return float(np.linalg.norm(np.median(lab[rope], axis=0) - np.median(lab[beside], axis=0)))
