"""What in a recording will mislead a fit: each with frame, size and what it does to the answer."""

from __future__ import annotations

import numpy as np

MARGIN = 4.0  # sd of the noise: a chord that is longer by less may be noise
LEAST_EXCESS = 1e-3  # m; chords longer than the rope by less are rounding
ONE_POSE, ONE_TURN = 2e-3, np.radians(1.0)  # m, rad: ends that move by less are in one pose
LEAST_FRAMES = 2  # in one end pose, for it to be said
CUT = 0.01  # of the length that straight lines between markers fall short of the rope


def ends_apart(frames: list[int], ends: np.ndarray, length: float | None) -> list[str]:
    """Return warnings on held ends (F, 2, 3) [m] that are farther apart than the rope is long."""
    if length is None:
        return []
    apart = np.nan_to_num(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
    beyond = apart - length
    if beyond.max(initial=0.0) <= LEAST_EXCESS / 10:
        return []
    worst = int(np.argmax(beyond))
    return [
        f"frame {frames[worst]}: the ends are {apart[worst]:.4g} m apart, "
        f"{beyond[worst] * 1e3:.1f} mm more than the rope is long "
        f"({_frames(int((beyond > LEAST_EXCESS / 10).sum()))}): a fit will explain this by "
        "stretch, a longer rope or moved ends; correct [rope] length or the ends"
    ]


def one_end_pose(ends: np.ndarray, clamps: np.ndarray) -> list[str]:
    """Return a warning where the ends stand alike to each other and to gravity in all frames.

    ends (F, 2, 3) [m] and clamps (F, 2, 4) as quaternions, NaN where not held.
    """
    held = np.isfinite(ends[:, :, 0])
    held &= held.any(axis=0)  # of a free end no frame
    full = held.sum(axis=1) == held.sum(axis=1).max()
    if full.sum() < LEAST_FRAMES or not held.any():
        return []
    across = np.nan_to_num(ends[full, 1] - ends[full, 0])
    moved = float(np.linalg.norm(across - across[0], axis=1).max())
    same = np.abs((np.nan_to_num(clamps[full]) * np.nan_to_num(clamps[full][:1])).sum(axis=2))
    clamped = np.isfinite(clamps[full]).all(axis=2)
    turned = float(2 * np.arccos(np.clip(same[clamped], 0, 1)).max(initial=0.0))
    if moved > ONE_POSE or turned > ONE_TURN:
        return []
    return [
        f"all {int(full.sum())} frames show one end pose (the ends move by {moved * 1e3:.1f} mm "
        f"and turn by {np.degrees(turned):.1f} degrees at most): to a rope at rest the frames "
        "repeat one measurement, so its rigidity, its length and errors of the set-up are "
        "hard to tell apart; record other poses"
    ]


def long_chords(
    frames: list[int], positions: np.ndarray, arc: np.ndarray, noise: float
) -> list[str]:
    """Return a warning where markers (F, M, 3) [m] are farther apart than their arc (M,) [m]."""
    chord = np.linalg.norm(np.diff(positions, axis=1), axis=2)
    beyond = np.nan_to_num(chord - np.diff(arc))
    least = max(LEAST_EXCESS, MARGIN * np.sqrt(2) * noise)
    if beyond.max(initial=0.0) <= least:
        return []
    t, marker = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    return [
        f"frame {frames[t]}: markers {marker} and {marker + 1} are {chord[t, marker] * 1e3:.1f} mm "
        f"apart, {beyond[t, marker] * 1e3:.1f} mm more than the rope between them "
        f"({_frames(int((beyond > least).any(axis=1).sum()))}): the curve is bent between them "
        "where the rope is not, or the rope seems to stretch; correct arc_length or the markers"
    ]


def jumped(frames: list[int], sizes: np.ndarray) -> list[str]:
    """Return a warning on each marker that is masked where it jumps by sizes (F, M) [m]."""
    found = []
    for marker in np.flatnonzero(sizes.any(axis=0)):
        worst = int(np.argmax(sizes[:, marker]))
        found.append(
            f"frame {frames[worst]}: marker {marker} jumps by {sizes[worst, marker] * 1e3:.0f} mm: "
            f"masked in {_frames(int((sizes[:, marker] > 0).sum()))}; it is not used there, and "
            "nothing else is changed"
        )
    return found


def cut_corners(positions: np.ndarray, ends: np.ndarray, length: float | None) -> list[str]:
    """Return a warning where lines between markers (F, M, 3) and ends (F, 2, 3) are too short.

    Only where all the rope is spanned and its length [m] is known, and the arc lengths are not.
    """
    line = np.concatenate([ends[:, :1], positions, ends[:, 1:]], axis=1)
    total = np.linalg.norm(np.diff(line, axis=1), axis=2).sum(axis=1)
    total = total[np.isfinite(total)]
    if length is None or not total.size or np.median(total) >= (1 - CUT) * length:
        return []
    short = 1 - float(np.median(total)) / length
    return [
        f"straight lines between the markers are {short:.1%} ({short * length * 1e3:.0f} mm) "
        "shorter than the rope: they cut corners, and places along the rope are wrong by up to as "
        "much; bends look wider than they are. Give arc_length, or more points where it bends"
    ]


def _frames(count: int) -> str:
    return f"{count} frame" + "s" * (count != 1)
