"""Whole frames that a clip of motion capture has lost: all markers missing, repeated or skipped."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.gaps import LONGEST_GAP, unbroken

LEAST_SKIP = 1.5  # steps at once, by the speeds before and after
MOST_ODD = 0.5  # of a skipping step that no such factor explains
OUTSTANDING = 8.0  # times the usual change of speed from step to step
LEAST_SPEED = 0.5  # of the usual: a rope that turns round has no speed to count steps by
NAMED = 5  # places that are named


class Lost(NamedTuple):
    """Rows (N,) of frames that are lost in a clip, and how many with each."""

    rows: np.ndarray
    count: np.ndarray


def skipped(positions: np.ndarray, time: np.ndarray) -> Lost:
    """Return frames before which markers (F, M, 3) [m] move several steps in one, by time (F,) [s].

    All of them then move as far as at the speed before and after in so many steps: a rope cannot.
    """
    rows, counts = [], []
    for part in unbroken(time):
        velocity = np.diff(positions[part], axis=0) / np.diff(time[part])[:, None, None]
        if len(velocity) < 3:
            continue
        three = np.stack([velocity[:-2], velocity[1:-1], velocity[2:]])  # before, here, after
        both = np.asarray(np.isfinite(three).all(axis=(0, 3)))[..., None]
        before, here, after = np.where(both, three, 0.0)
        beside = (before + after) / 2
        steps = _times(here, beside)
        speed, change = _size(here), _size(here - beside)
        found = np.minimum(_times(here, before), _times(here, after)) > LEAST_SKIP
        found &= _size(here - steps[:, None, None] * beside) < MOST_ODD * speed
        found &= change > OUTSTANDING * np.median(change)
        found &= speed > LEAST_SPEED * np.median(speed)
        at = np.flatnonzero(found)
        rows.append(part[at + 2])
        counts.append(np.maximum(np.round(steps[at]) - 1, 1))
    if not rows:
        return Lost(np.zeros(0, int), np.zeros(0, int))
    return Lost(np.concatenate(rows), np.concatenate(counts).astype(int))


def _times(here: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return (N,) how many times velocities (N, M, 3) are the others."""
    return (here * other).sum(axis=(1, 2)) / np.maximum((other**2).sum(axis=(1, 2)), 1e-300)


def _size(velocity: np.ndarray) -> np.ndarray:
    return np.linalg.norm(velocity, axis=(1, 2))


def repeated(positions: np.ndarray) -> np.ndarray:
    """Return (F,) bool: frames in which no marker (F, M, 3) [m] moves at all, between frames in
    which they do."""
    seen = np.asarray(np.isfinite(positions).all(axis=2))
    step = np.linalg.norm(np.nan_to_num(np.diff(positions, axis=0)), axis=2).max(axis=1, initial=0)
    same = (step == 0) & seen[1:].any(axis=1) & (seen[1:] == seen[:-1]).all(axis=1)
    again = np.concatenate([[False], same])
    moves = np.flatnonzero(~same)
    if not same.any() or not moves.size:
        return np.zeros(len(positions), bool)
    again[: moves[0] + 1] = again[moves[-1] + 1 :] = False  # at rest before, or after
    return again


def lost_frames(frames: list[int], positions: np.ndarray, time: np.ndarray | None) -> list[str]:
    """Return warnings on frames in which all markers (F, M, 3) [m] are missing, repeated or
    skipped; the last two only where there is a time (F,) [s]."""
    seen = np.asarray(np.isfinite(positions).all(axis=2)).any(axis=1)
    messages = []
    number = np.array(frames)
    if not seen.all():
        messages.append(
            f"no marker is seen in {_named(number[~seen])}: excluded; in a motion the ends are "
            f"interpolated there, and a clip is cut in two where more than {LONGEST_GAP:.0f} steps "
            "are missing"
        )
    if time is None or not np.isfinite(time).all():
        return messages
    again = repeated(positions)
    if again.any():
        messages.append(
            f"all markers stand exactly where they were in {_named(number[again])}, but move "
            "before and after: these frames repeat others; a motion sees the rope stop and start "
            "there, which damping and inertia then answer for; give no marker in them (NaN)"
        )
    fresh = np.flatnonzero(seen & ~again)
    rows, count = skipped(positions[fresh], time[fresh])
    if rows.size:
        messages.append(
            f"all markers move several steps at once before {_named(number[fresh[rows]])}: about "
            f"{_frames(int(count.sum()))} lost there, which the times do not tell; a motion sees a "
            "blow there, which rigidity, damping and what is called missing then answer for; "
            "correct the times or leave these clips out"
        )
    return messages


def _named(frames: np.ndarray) -> str:
    names = ", ".join(str(frame) for frame in frames[:NAMED])
    if len(frames) == 1:
        return f"frame {names}"
    return f"{_frames(len(frames))} ({names}{', ...' if len(frames) > NAMED else ''})"


def _frames(count: int) -> str:
    return f"{count} frame" + "s" * (count != 1)
