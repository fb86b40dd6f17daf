"""One mask of a picture followed as a rope, or why it shows none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from ropefit.perception.cues import MOST_AREA
from ropefit.perception.linking import Path, link
from ropefit.perception.ropiness import ROPE_ASPECT, ropiness
from ropefit.perception.strands import Strands, cut_at_jumps, find_strands

LEAST_PATH = 30.0  # px
COMPARABLE = 0.5  # of the length, of the score: another rope


@dataclass(frozen=True)
class Candidate:
    """One mask followed as a rope; others: whether it shows another one about as long."""

    cue: str
    mask: np.ndarray
    strands: Strands
    path: Path
    score: float
    others: bool


def candidate_of(
    cue: str, mask: np.ndarray, lab: np.ndarray, ends: np.ndarray, depth: np.ndarray | None = None
) -> Candidate | str:
    """Return a mask followed as a rope, or why it shows none."""
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    share, most = closed.mean(), MOST_AREA * (1 if cue != "the given mask" else 10)
    if share == 0:
        return "no pixel"
    if share >= most:
        return f"{share:.0%} of the picture, a rope fills less than {most:.0%}"
    mask = without_specks(closed)
    strands = find_strands(mask)
    if strands is None:
        return "no line"
    if depth is not None:
        strands = replace(strands, lines=cut_at_jumps(strands.lines, depth, strands.width))
    paths = link(strands.lines, strands.width, ends, depth)
    if not paths or paths[0].length < LEAST_PATH:
        longest = paths[0].length if paths else 0.0
        return f"the longest line has {longest:.0f} px, a rope at least {LEAST_PATH:.0f}"
    score = ropiness(mask, strands, paths[0], lab, ends)
    least = max(COMPARABLE * paths[0].length, ROPE_ASPECT * strands.width)
    long = any(path.length * path.seen.mean() > least for path in paths[1:])
    others = long and not np.isfinite(ends).all()
    return Candidate(cue, mask, strands, paths[0], score, others)


def without_specks(mask: np.ndarray) -> np.ndarray:
    """Return (H, W) bool: components that are not tiny against the largest ones."""
    count, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return mask > 0
    extent = np.hypot(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    extent[0] = 0
    least = max(0.15 * np.sort(extent)[-min(3, count - 1)], 4.0)
    return (extent >= least)[label]
