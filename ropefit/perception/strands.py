"""A mask taken apart into strands: stretches of its medial line that do not branch."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d, median_filter, minimum_filter1d
from scipy.spatial import KDTree
from skimage.morphology import skeletonize

MOST_PIXELS = 60_000
MOST_LINES = 1000  # more are the grain of a surface; no rope in this project's pictures has 300
SPUR = 1.5  # widths: a shorter branch of the skeleton is a bump of the outline
THICK = 1.7  # times the rope's width: a wider part of the mask is something else
JUMP = 0.04  # of the depth within a width: no rope leans that much
SMOOTHING = 1.5  # px: skeleton pixels are jagged by one
# Neighbours of a pixel in the order in which a walk along the skeleton tries them.
STEPS = ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))


@dataclass(frozen=True)
class Strands:
    """lines: (P, 2) ordered pixels (u, v) each, ends included; width [px] of the rope in the mask;
    share of the mask's area that the strands account for."""

    lines: list[np.ndarray]
    width: float
    share: float


def find_strands(mask: np.ndarray) -> Strands | None:
    """Return strands of a mask (H, W) bool, or None where there is nothing thin to follow.

    Where the skeleton branches (a crossing, a spur, a thing that touches) it is cut; what is much
    wider than the rope is ignored. The rope's width [px] is the one that most of the thin
    skeleton has.
    """
    box = _box(mask)
    if box is None:
        return None
    rows, columns = box
    part = np.pad(mask[rows, columns], 2).astype(np.uint8)
    radius = cv2.distanceTransform(part, cv2.DIST_L2, 5)
    thin = skeletonize(part > 0)
    if not 2 <= np.count_nonzero(thin) <= MOST_PIXELS:
        return None
    width = _usual_width(radius[thin])
    thin &= radius <= THICK * width / 2 + 1
    kernel = np.ones((3, 3), np.uint8)
    near = cv2.filter2D(thin.astype(np.uint8), -1, kernel, borderType=cv2.BORDER_CONSTANT)
    joints = thin & (near > 3) & _branching(thin)
    thin &= ~_grown(joints)
    if cv2.connectedComponents(thin.astype(np.uint8))[0] > MOST_LINES:
        return None
    lines = _walk(thin)
    lines = [line for line in lines if len(line) >= 2]
    if not lines:
        return None
    lines = _without_spurs(lines, np.argwhere(joints), width)
    offset = np.array([columns.start - 2, rows.start - 2], dtype=float)
    lines = [_smooth(line[:, ::-1].astype(float)) + offset for line in lines]
    length = sum(len(line) for line in lines)
    share = min(length * width / max(np.count_nonzero(mask), 1), 1.0)
    return Strands(lines, width, share)


def cut_at_jumps(lines: list[np.ndarray], depth: np.ndarray, width: float) -> list[np.ndarray]:
    """Return strands (P, 2) [px] without the places at which depth (H, W) [m], 0 = none, jumps, cut
    there: a rope hangs together in space too, what it passes in the picture need not."""
    out = []
    near, limit = max(int(width), 3), np.array(depth.shape[::-1]) - 1
    for line in lines:
        column, row = np.clip(np.round(line).astype(int), 0, limit).T
        z = depth[row, column]
        there = np.flatnonzero(z > 0)
        if len(there) < 2 * near:
            out.append(line)
            continue
        z = np.interp(np.arange(len(z)), there, median_filter(z[there], 2 * near + 1))
        jump = maximum_filter1d(z, near) - minimum_filter1d(z, near) > JUMP * z
        parts = np.split(np.arange(len(z)), np.flatnonzero(np.diff(jump.astype(int))) + 1)
        out += [line[part] for part in parts if not jump[part[0]] and len(part) >= 2]
    return out


def _box(mask: np.ndarray) -> tuple[slice, slice] | None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if rows.size == 0:
        return None
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _usual_width(radius: np.ndarray) -> float:
    """Return the width [px] that the most of a skeleton has, long and thin counting more than short
    and thick: a blot of the same area has a skeleton as much shorter as it is wider."""
    logs = np.log2(np.maximum(2 * radius, 1.0))
    count, edges = np.histogram(logs, bins=np.arange(0, 10.01, 0.25))
    # Three bins together, so that a width between two is not split.
    merged = np.convolve(count, [1, 1, 1], mode="same") * 2.0 ** (-0.5 * edges[:-1])
    best = int(np.argmax(merged))
    inside = (logs >= edges[max(best - 1, 0)]) & (logs < edges[min(best + 2, len(edges) - 1)])
    return float(max(np.median(2 * radius[inside]), 1.0))


def _branching(thin: np.ndarray) -> np.ndarray:
    """Return skeleton pixels from which three or more ways lead (changes around the pixel / 2)."""
    ring = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
    around = [np.roll(thin, (-dv, -du), (0, 1)) for dv, du in ring]
    ways = sum(
        (~a & b).astype(np.uint8) for a, b in zip(around, [*around[1:], around[0]], strict=True)
    )
    return np.asarray(ways) >= 3


def _grown(joints: np.ndarray) -> np.ndarray:
    return cv2.dilate(joints.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _walk(thin: np.ndarray) -> list[np.ndarray]:
    """Return (P, 2) rows and columns of every unbranched stretch, in order."""
    pixels = {(int(r), int(c)) for r, c in np.argwhere(thin)}

    def neighbours(at: tuple[int, int]) -> list[tuple[int, int]]:
        r, c = at
        return [(r + dr, c + dc) for dr, dc in STEPS if (r + dr, c + dc) in pixels]

    # Tips first: what is left after them are rings.
    tips = [at for at in sorted(pixels) if len(neighbours(at)) <= 1]
    lines = []
    for start in [*tips, *sorted(pixels)]:
        if start not in pixels:
            continue
        line, at = [start], start
        pixels.discard(start)
        while ways := neighbours(at):
            at = ways[0]
            pixels.discard(at)
            line.append(at)
        lines.append(np.array(line))
    return lines


def _without_spurs(lines: list[np.ndarray], joints: np.ndarray, width: float) -> list[np.ndarray]:
    """Leave out short stretches that begin at a branching: spurs, and the middle of crossings."""
    if len(joints) == 0:
        return lines
    tree = KDTree(joints)
    kept = []
    for line in lines:
        away = np.asarray(tree.query(line[[0, -1]].astype(float))[0])
        if len(line) < SPUR * width + 2 and away.min() < 4:
            continue
        kept.append(line)
    return kept


def _smooth(line: np.ndarray) -> np.ndarray:
    return gaussian_filter1d(line, SMOOTHING, axis=0, mode="nearest") if len(line) > 4 else line
