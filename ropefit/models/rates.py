"""How fast what was observed in frames changes, and how fast that does."""

from __future__ import annotations

import numpy as np

WINDOW = 3  # frames on either side that a parabola in time is fitted to
# On either side of a quartic: three quarters of the noise, a quarter of the bias.
WIDER = 6


def rates(
    time: np.ndarray, values: np.ndarray, clips: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the first and second derivative in time of values (F, ...), by a polynomial through
    the frames about each: a quartic, and a parabola where a clip begins and ends."""
    first, second = np.zeros_like(values), np.zeros_like(values)
    for clip in clips:
        last = len(clip) - 1
        for place, t in enumerate(clip):
            inside = WIDER <= place <= last - WIDER
            half, degree = (WIDER, 4) if inside else (WINDOW, 2)
            low = int(np.clip(place - half, 0, last - 2 * half))
            near = clip[low : low + 2 * half + 1]
            step = float(np.ptp(time[near])) / len(near)
            powers = np.vander((time[near] - time[t]) / step, degree + 1, increasing=True)
            fitted = np.einsum("pk,k...->p...", np.linalg.pinv(powers), values[near])
            first[t], second[t] = fitted[1] / step, 2 * fitted[2] / step**2
    return first, second
