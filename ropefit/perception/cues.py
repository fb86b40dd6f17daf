"""Cues that may tell a rope from its surroundings: each gives masks, and says what it looked at."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

COLOURS = 8
LIGHTNESS = 0.35  # weight of lightness against hue where colours are compared: shading
SAME_COLOUR = 25.0  # distance in Lab to a given colour
MIXED = 45  # distance of colours that may be light and shade of one rope
SPREAD = 1 / 10  # of the image: surroundings that a rope is much thinner than
UNLIKE = (48.0, 24.0, 12.0, 6.0)  # distances in Lab to the surroundings, from plain to faint
NEARER = 0.004  # m before the surroundings: less is noise of a depth camera
NO_DEPTH = 65535  # in nearness
MOST_AREA = 0.15  # of the image: more is no rope


def lab_of(color: np.ndarray, blur: float = 0.0) -> np.ndarray:
    """Return (H, W, 3) float32 CIE Lab, L 0..100, of an RGB image (H, W, 3) uint8."""
    image = cv2.GaussianBlur(color, (0, 0), blur) if blur > 0 else color
    return cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)


def around(lab: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) what surrounds each pixel: medians over windows that a rope is thinner
    than."""
    height, width = lab.shape[:2]
    shrink = max(min(height, width) // 120, 1)
    size = (max(width // shrink, 1), max(height // shrink, 1))
    small = cv2.resize(lab, size, interpolation=cv2.INTER_AREA)
    window = 2 * int(SPREAD * min(size) / 2) + 1
    low, high = np.array([0, -128, -128], np.float32), np.array([100, 127, 127], np.float32)
    bytes_ = np.clip((small - low) / (high - low) * 255, 0, 255).astype(np.uint8)
    median = cv2.medianBlur(bytes_, max(window, 3)).astype(np.float32) / 255 * (high - low) + low
    return cv2.resize(median, (width, height), interpolation=cv2.INTER_LINEAR)


def unlike_masks(lab: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Return masks of what differs from its surroundings, whatever its colour is."""
    away = np.linalg.norm(lab - around(lab), axis=2)
    for level in UNLIKE:
        mask = away > level
        if 0 < mask.mean() < MOST_AREA:
            yield f"unlike its surroundings by {level:g}", mask


def colour_masks(lab: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Return masks of the main colours, of small but vivid ones, and of pairs that are much
    alike."""
    weighted = lab * np.array([LIGHTNESS, 1, 1], np.float32)
    centres, label = _clusters(weighted)
    for k in range(len(centres)):
        yield f"colour {k + 1}", label == k
    for a in range(len(centres)):
        for b in range(a + 1, len(centres)):
            if np.linalg.norm(centres[a] - centres[b]) < MIXED:
                yield f"colours {a + 1} and {b + 1}", (label == a) | (label == b)


def _clusters(lab: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (centres (K, 3), label (H, W)) of an image of weighted Lab."""
    flat = lab.reshape(-1, 3)
    chroma = np.linalg.norm(flat[:, 1:] - np.median(flat[::7, 1:], axis=0), axis=1)
    # A rope is a percent of the picture: sample vivid pixels as often as common ones.
    rng = np.random.default_rng(0)
    common = rng.choice(len(flat), min(4000, len(flat)), replace=False)
    most = min(max(len(flat) // 50, 100), len(flat) - 1)
    vivid = np.argpartition(chroma, -most)[-most:]
    sample = flat[np.concatenate([common, rng.choice(vivid, min(4000, len(vivid)), False)])]
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.5)
    cv2.setRNGSeed(0)
    count = min(COLOURS, len(np.unique(sample, axis=0)))
    _, _, centres = cv2.kmeans(sample, count, None, criteria, 2, cv2.KMEANS_PP_CENTERS)  # type: ignore[call-overload]
    # Of |x - c|² the part |x|² is the same for every centre.
    distance = (centres**2).sum(axis=1) - 2 * flat @ centres.T
    return centres, distance.argmin(axis=1).reshape(lab.shape[:2])


def nearness(depth: np.ndarray) -> np.ndarray:
    """Return (H, W) uint16 [mm] by how much each pixel of depth (H, W) [m] stands before its
    surroundings; 0 where it does not, NO_DEPTH where there is none."""
    height, width = depth.shape
    shrink = max(min(height, width) // 120, 1)
    size = (max(width // shrink, 1), max(height // shrink, 1))
    millimetres = np.clip(depth * 1000, 0, NO_DEPTH - 1).astype(np.uint16)
    small = cv2.resize(millimetres, size, interpolation=cv2.INTER_NEAREST)
    behind = cv2.medianBlur(cv2.dilate(cv2.medianBlur(small, 5), np.ones((5, 5), np.uint8)), 5)
    behind = cv2.resize(behind, (width, height), interpolation=cv2.INTER_LINEAR)
    near = cv2.subtract(behind, millimetres)
    near[millimetres == 0] = NO_DEPTH
    return near


def depth_mask(depth: np.ndarray) -> np.ndarray:
    """Return (H, W) bool: what stands before its surroundings in depth (H, W) [m], 0 = none."""
    near = nearness(depth)
    behind = depth + near / 1000
    return (near < NO_DEPTH) & (near > 1000 * np.maximum(NEARER, 0.006 * behind))


def near_colour(lab: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Return (H, W) bool: pixels near an RGB colour, lightness counting less."""
    weight = np.array([LIGHTNESS, 1, 1], np.float32)
    goal = lab_of(np.array(color, np.uint8).reshape(1, 1, 3))
    return np.linalg.norm((lab - goal) * weight, axis=2) < SAME_COLOUR
