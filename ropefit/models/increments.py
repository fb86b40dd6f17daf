"""Frames in between, through which a rope is led whose state depends on its path.

Friction holds a node from where it touched down. From one recorded pose to the next the ends may
drag what has just touched down over centimetres. Bending that slips at a limit is returned to it
radially, which is exact only as long as its direction stays. So the way between is followed.
"""

from __future__ import annotations

import numpy as np

from ropefit.models.bends import vectors
from ropefit.rod import memory
from ropefit.rod.friction import push
from ropefit.rod.memory import Laws
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Motion, Setup
from ropefit.solvers.equilibrium.solution import Solution

STRIDE = 0.016  # of the length: with a fifth of it the χ² of a dragged rope changed by 5 %
BENT = 0.2  # of the curvature at which bending slips
MOST_INCREMENTS = 6  # increments from one frame to the next


def increments_of(
    whole: Setup, rough: list[Potential], law: Laws, smooth: Solution, spins: bool
) -> np.ndarray:
    """Return (H,) in how many increments each of H frames is reached from the one before.

    rough: contacts with friction; smooth: all frames without any, nor memory of what was before;
    spins: whether the rope is free to spin, so that its directors are arbitrary in each frame.
    """
    wanted = np.maximum(_rubbed(whole, rough, smooth.x), _bent(law, vectors(smooth), spins))
    wanted = np.where(memory.restarts(whole.clock), 1, wanted)
    wanted = np.nan_to_num(wanted, nan=MOST_INCREMENTS)  # of frames that do not settle without
    return np.clip(np.ceil(wanted), 1, MOST_INCREMENTS).astype(int)


def _rubbed(whole: Setup, rough: list[Potential], x: np.ndarray) -> np.ndarray:
    """Return (H,) how many strides the ends move in frames in which nodes x (H, N+1, 3) [m] touch
    down; zero in the others."""
    down = np.zeros(len(x), dtype=bool)
    for contact in rough:
        touches = (push(contact, x) != 0).any(-1)
        down[1:] |= (touches[1:] & ~touches[:-1]).any(axis=1)
    length = float(whole.properties.length.sum())
    way = np.linalg.norm(np.diff(whole.ends, axis=0, prepend=whole.ends[:1]), axis=-1)
    return np.where(down, np.nan_to_num(way).max(axis=1) / (STRIDE * length), 0.0)


def _bent(law: Laws, vector: np.ndarray, spins: bool) -> np.ndarray:
    """Return (H,) by how many steps of `BENT` the bend elements (H, N+1, 2) change where they slip
    at a limit."""
    sharp = (law.drag > 0) & np.isfinite(law.slip) & ~law.gradual[:, None]
    if not sharp.any():
        return np.zeros(len(vector))
    now, before = vector[1:] @ [1, 1j], vector[:-1] @ [1, 1j]
    if spins:
        turn = (before * now.conj()).sum(axis=1, keepdims=True)
        now = now * np.exp(1j * np.angle(turn))
    least = np.where(sharp, law.slip, np.inf).min(axis=0)
    return np.concatenate([[0.0], (np.abs(now - before) / least).max(axis=1) / BENT])


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
