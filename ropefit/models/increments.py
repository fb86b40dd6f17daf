"""Frames in between, through which a rope that rubs is led where it touches down.

Friction holds a node from where it touched down. From one recorded pose to the next the ends may
drag what has just touched down over centimetres, so that the way between is followed.
"""

from __future__ import annotations

import numpy as np

from ropefit.rod import memory
from ropefit.rod.friction import push
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Motion, Setup

STRIDE = 0.016  # of the length: with a fifth of it the χ² of a dragged rope changed by 5 %
MOST_INCREMENTS = 6  # increments from one frame to the next


def increments_of(whole: Setup, rough: list[Potential], x: np.ndarray) -> np.ndarray:
    """Return (H,) in how many increments each of H frames is reached from the one before.

    One, but where nodes touch down. rough: contacts with friction; x (H, N+1, 3) [m]: where the
    rope would be without any.
    """
    down = np.zeros(len(x), dtype=bool)
    for contact in rough:
        touches = (push(contact, x) != 0).any(-1)
        down[1:] |= (touches[1:] & ~touches[:-1]).any(axis=1)
    length = float(whole.properties.length.sum())
    way = np.linalg.norm(np.diff(whole.ends, axis=0, prepend=whole.ends[:1]), axis=-1)
    far = np.nan_to_num(way).max(axis=1) / (STRIDE * length)
    down &= ~memory.restarts(whole.clock)
    return np.where(down, np.clip(np.ceil(far), 1, MOST_INCREMENTS), 1).astype(int)


def in_increments(whole: Setup, parts: np.ndarray) -> Setup:
    """Return a setup with the frames in between: ends and loads straight from one to the next."""
    if (parts == 1).all():
        return whole
    place = np.concatenate([t - 1 + np.arange(1, n + 1) / n for t, n in enumerate(parts)])
    place = np.maximum(place, 0.0)
    after = np.ceil(place - 1e-9).astype(int)
    before = np.maximum(after - 1, 0)
    share = 1.0 - (after - place)

    def between(values: np.ndarray) -> np.ndarray:
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[before] + part * (values[after] - values[before])

    out = whole.frames(after)
    motion = None if whole.motion is None else Motion(*(between(v) for v in whole.motion))
    return out._replace(
        past=None, time=between(whole.clock), ends=between(whole.ends), motion=motion,
        clamp=_turned(whole.clamp[before], whole.clamp[after], share),
        load=between(whole.load) if whole.load.ndim == 3 else whole.load,
    )  # fmt: skip


def _turned(one: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return the unit quaternions (H, 2, 4) a share (H,) of the way from one to the other; NaN
    where nothing is held."""
    sign = np.where((one * other).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    part = share[:, None, None]
    mean = (1 - part) * sign * one + part * other
    return np.where(part == 1, other, mean / np.linalg.norm(mean, axis=-1, keepdims=True))
