"""Options that hold several numbers, and poses between samples."""

from __future__ import annotations

import numpy as np

from ropefit.errors import WrongUsage


def vector(option: str, text: str, count: int = 3) -> np.ndarray:
    """Return (count,) numbers with commas between. Raises WrongUsage."""
    try:
        values = np.array([float(item) for item in text.split(",")])
    except ValueError:
        values = np.array([])
    if values.shape != (count,) or not np.isfinite(values).all():
        raise WrongUsage(f"--set {option}={text}: expected {count} numbers with commas between")
    return values


def rotation(q: np.ndarray) -> np.ndarray:
    """Return (3, 3) matrix of a unit quaternion w x y z."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (4,) Hamilton product p q."""
    pw, pv, qw, qv = p[0], p[1:], q[0], q[1:]
    return np.concatenate([[pw * qw - pv @ qv], pw * qv + qw * pv + np.cross(pv, qv)])


def nearest(times: np.ndarray, wanted: float) -> int:
    """Return index of the entry of increasing `times` (N,) that is nearest to `wanted`."""
    at = int(np.searchsorted(times, wanted))
    near = [index for index in (at - 1, at) if 0 <= index < len(times)]
    return min(near, key=lambda index: abs(times[index] - wanted))


def pose_at(
    times: np.ndarray, positions: np.ndarray, quaternions: np.ndarray, wanted: float, gap: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return position (3,) and quaternion (4,) at a time, between the samples beside it.

    times: (N,) increasing [s]; None where no sample lies within `gap` [s].
    """
    index = nearest(times, wanted)
    if abs(times[index] - wanted) > gap:
        return None
    other = index + (1 if times[index] < wanted else -1)
    if not 0 <= other < len(times) or abs(times[other] - wanted) > gap:
        return positions[index], quaternions[index]
    span = times[other] - times[index]
    share = (wanted - times[index]) / span if span else 0.0
    a, b = quaternions[index], quaternions[other]
    b = b if a @ b >= 0 else -b  # the short way round
    between = (1 - share) * a + share * b
    position = (1 - share) * positions[index] + share * positions[other]
    return position, between / np.linalg.norm(between)
