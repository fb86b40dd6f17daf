"""Which frames belong together, which are held out, which are used for the fit."""

from __future__ import annotations

import re

import numpy as np

from ropefit.artifacts import Observations
from ropefit.errors import BadInput, WrongUsage
from ropefit.rod.setup import Setup

LEAST_TO_HOLD_OUT = 8
CALM = 0.05  # of the frames of a rope in motion
LIVELY = 0.05  # of gravity: where a rope accelerates less, any frame is calm


def group_frames(observations: Observations, spec: str) -> np.ndarray:
    """Return (F,) group number of each frame.

    spec: "one"; "tension" (bending and tensioned frames, parted by the distance of the ends); or
    ranges of frame numbers such as "0-17,18-35".
    """
    frames = observations.frames
    if spec == "one":
        return np.zeros(len(frames), dtype=np.int64)
    if spec == "tension":
        return _by_tension(observations)
    group = np.full(len(frames), -1, dtype=np.int64)
    for number, part in enumerate(spec.split(",")):
        match = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if not match:
            raise WrongUsage(f"groups {spec!r}: expected one, tension or ranges such as 0-17,18-35")
        first, last = int(match.group(1)), int(match.group(2) or match.group(1))
        inside = (frames >= first) & (frames <= last)
        if not inside.any():
            raise WrongUsage(f"groups {spec!r}: no frame in {part.strip()}")
        if (group[inside] >= 0).any():
            raise WrongUsage(f"groups {spec!r}: {part.strip()} overlaps an earlier range")
        group[inside] = number
    if (group < 0).any():
        raise WrongUsage(f"groups {spec!r}: frame {frames[np.argmin(group)]} is in no group")
    return group


def _by_tension(observations: Observations) -> np.ndarray:
    """Return 0 = bending, 1 = tensioned: the split of |a - b| that leaves the least variance
    inside."""
    ends = observations.end_position
    apart = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    if not np.isfinite(apart).all():
        raise BadInput("groups by tension need both ends held; give ranges of frames instead")
    ordered = np.sort(apart)
    if ordered[-1] - ordered[0] < 0.05 * observations.length:
        raise BadInput("groups by tension: the ends stay equally far apart in all frames")
    inside = [
        ordered[:k].var() * k + ordered[k:].var() * (len(ordered) - k)
        for k in range(1, len(ordered))
    ]
    threshold = ordered[int(np.argmin(inside)) + 1]
    return (apart >= threshold).astype(np.int64)


def held_out(count: int, share: float) -> np.ndarray:
    """Return (F,) bool: contiguous blocks of frames, spread over the recording, that no fit may
    see."""
    out = np.zeros(count, dtype=bool)
    if count < LEAST_TO_HOLD_OUT or share == 0:
        return out
    blocks = max(2, min(5, round(share * count / 2)))
    size = max(1, round(share * count / blocks))
    for block in range(blocks):
        middle = (block + 0.5) / blocks * count
        first = int(np.clip(round(middle - size / 2), 0, count - size))
        out[first : first + size] = True
    return out


def spread_evenly(frames: np.ndarray, group: np.ndarray, most: int) -> np.ndarray:
    """Return at most `most` of the frame indices, evenly spread within every group."""
    groups = np.unique(group)
    kept = []
    for number in groups:
        mine = frames[group[frames] == number]
        if mine.size == 0:
            raise BadInput("a group has no frame left for the fit; lower --holdout")
        count = max(1, most // len(groups))
        kept.append(mine[np.unique(np.linspace(0, mine.size - 1, count).round().astype(int))])
    return np.sort(np.concatenate(kept))


def calmest(frames: np.ndarray, setup: Setup, least: int) -> np.ndarray:
    """Return for frames (their indices) of a rope in motion, those in which it accelerates least,
    `least` of them or more: there a model at rest is nearest to the truth. All of a rope at rest.
    """
    if setup.motion is None:
        return frames
    size = np.square(setup.motion.acceleration[frames]).sum(-1).mean(-1)
    usual = np.quantile(size, 0.5, method="lower")
    if np.sqrt(usual) < LIVELY * np.linalg.norm(setup.gravity):
        return frames
    count = max(least, round(CALM * len(frames)))
    return np.sort(frames[np.argsort(size, kind="stable")[:count]])
