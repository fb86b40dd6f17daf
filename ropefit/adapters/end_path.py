"""The path of the ends through their recorded poses."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from ropefit.gaps import LONGEST_GAP, unbroken
from ropefit.rod.parallel_transport import continuous
from ropefit.rod.path import EndPath

LEAST_POSES = 4  # of a clip: cubics go through them
LEAST_MOVE = 1e-3  # of the length: ends that move less from frame to frame stay where they are
SAME_TIME = 1e-6  # s


def end_path(
    time: np.ndarray | None,
    frames: np.ndarray,
    ends: np.ndarray,
    clamp: np.ndarray,
    length: float,
) -> EndPath | None:
    """Return the path through poses of the ends (F, 2, 3) [m] and clamps (F, 2, 4) at times (F,).

    None where there are no times, or none but frames (F,), their numbers, as of poses that were
    held still; where a clip is too short to interpolate; or where no end moves.
    """
    if time is None or len(time) < LEAST_POSES or np.abs(time - frames).max() < SAME_TIME:
        return None
    clips = unbroken(time)
    position, turn = np.nan_to_num(ends), np.nan_to_num(continuous(clamp))
    moves = np.linalg.norm(np.diff(position, axis=0), axis=-1) / length
    turns = np.linalg.norm(np.diff(turn, axis=0), axis=-1)
    if min(map(len, clips)) < LEAST_POSES or max(moves.max(), turns.max()) < LEAST_MOVE:
        return None
    step, begin, piece = float(np.median(np.diff(time[clips[0]]))), 0.0, 0
    own: list[list[np.ndarray]] = []
    pieces: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for clip in clips:
        at, many = time[clip] - time[clip[0]] + begin, len(clip) - 1
        pieces.append((at[:-1], *(CubicSpline(at, v[clip]).c for v in (position, turn))))
        one = np.ones(len(clip))
        own.append(
            [at, piece * one, (piece + many - 1) * one, at[0] * one - step, at[-1] + step * one]
        )
        begin, piece = at[-1] + LONGEST_GAP * step, piece + many
    clock, first, last, earliest, latest = (np.concatenate(v) for v in zip(*own, strict=True))
    start, places, rotations = zip(*pieces, strict=True)
    arrays = (
        clock, first.astype(np.int64), last.astype(np.int64), earliest, latest,
        np.concatenate(start), np.concatenate(places, axis=1), np.concatenate(rotations, axis=1),
    )  # fmt: skip
    return EndPath(*arrays, step=step)
