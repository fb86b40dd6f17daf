"""Frames in between, through which a rope is led whose state depends on its path.

Friction holds a node from where it touched down. From one recorded pose to the next the ends may
drag what has just touched down over centimetres. Bending that slips at a limit is returned to it
radially, which is exact only as long as its direction stays. So the way between is followed.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ropefit.models.bends import vectors
from ropefit.rod import memory
from ropefit.rod.friction import push
from ropefit.rod.memory import Laws
from ropefit.rod.potential import Potential
from ropefit.rod.setup import Motion, Setup
from ropefit.solvers.equilibrium.solution import Solution

STRIDE = 0.016  # of the length: with a fifth of it the χ² of a dragged rope changed by 5 %
SLIP_ERROR = 0.008  # of the largest elastic moment: tolerated of what slipped between frames
MOST_INCREMENTS = 6  # from one frame to the next
FEWER = 1, 2, 3  # increments; divisors of the most


def increments_of(
    whole: Setup, rough: list[Potential], law: Laws, spins: bool,
    without_past: Callable[[np.ndarray], Solution],
) -> np.ndarray:  # fmt: skip
    """Return (H,) in how many increments each of H frames is reached from the one before.

    rough: contacts with friction; spins: whether the rope is free to spin, so that its directors
    are arbitrary in each frame. without_past(parts (H,)): the equilibria of all frames in between,
    without friction or memory.
    """
    begins, out = memory.restarts(whole.clock), np.ones(len(whole.ends), dtype=int)
    if rough:
        strides = _strides(whole, rough, without_past(out).x)
        out = np.maximum(out, np.clip(np.ceil(strides), 1, MOST_INCREMENTS).astype(int))
    if _slips(law).any():
        fine = without_past(np.where(begins, 1, MOST_INCREMENTS))
        out = np.maximum(out, _until_exact(law, fine, begins, spins))
    return np.where(begins, 1, out)


def _strides(whole: Setup, rough: list[Potential], x: np.ndarray) -> np.ndarray:
    """Return (H,) how many strides the ends move in frames in which nodes x (H, N+1, 3) [m] touch
    down; zero in the others."""
    down = np.zeros(len(x), dtype=bool)
    for contact in rough:
        touches = (push(contact, x) != 0).any(-1)
        down[1:] |= (touches[1:] & ~touches[:-1]).any(axis=1)
    length = float(whole.properties.length.sum())
    way = np.linalg.norm(np.diff(whole.ends, axis=0, prepend=whole.ends[:1]), axis=-1)
    return np.where(down, np.nan_to_num(way).max(axis=1) / (STRIDE * length), 0.0)


def _slips(law: Laws) -> np.ndarray:
    """Return which branches (B,) slip at a limit."""
    return (law.drag > 0).any(axis=1) & np.isfinite(law.slip).all(axis=1) & ~law.gradual


def _until_exact(law: Laws, fine: Solution, begins: np.ndarray, spins: bool) -> np.ndarray:
    """Return (H,) in how many increments each frame is reached so that what slips on the way, which
    is that of the `fine` frames, ends where it does in the most."""
    sharp, out = _slips(law), np.ones(len(begins), dtype=int)
    rest, stiffness = (
        a.reshape(-1, law.drag.shape[1], 3)[0] for a in (fine.rod.rest, fine.rod.stiffness)
    )
    slip, v, unloaded = law.slip[sharp], vectors(fine), rest[:, :2]
    moment = stiffness[:, 0] * np.nanmax(np.linalg.norm(v - unloaded, axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        tolerated = SLIP_ERROR * moment / law.drag[sharp]
    tolerated = np.nan_to_num(tolerated, nan=np.inf, posinf=np.inf)  # where nothing bends
    if spins:
        v = _aligned(v)
    strain, last = np.zeros((*slip.shape, 2)), 0
    for t, first in enumerate(begins):
        if first:
            loaded = np.where(law.fresh[sharp, None, None], v[last] - unloaded, 0.0)
            strain = memory.clipped(loaded, slip)[0]
            last += 1
            continue
        way = v[last - 1 : last + MOST_INCREMENTS]
        exact, last = _slipped(strain, way, slip), last + MOST_INCREMENTS
        for parts in (*FEWER, MOST_INCREMENTS):
            out[t] = parts
            error = _slipped(strain, way[:: MOST_INCREMENTS // parts], slip) - exact
            if (np.linalg.norm(error, axis=-1) <= tolerated).all():
                break
        strain = np.where(np.isfinite(exact), exact, strain)
    return out


def _aligned(vector: np.ndarray) -> np.ndarray:
    """Return vectors (n, N+1, 2) of a rope that is free to spin, each frame turned about the rope
    as near as it comes to the one before that settled."""
    v = vector @ [1, 1j]
    for before, t in pairwise(np.flatnonzero(np.isfinite(v).all(axis=1))):
        v[t] *= np.exp(1j * np.angle(np.vdot(v[t], v[before])))
    return np.stack([np.real(v), np.imag(v)], axis=-1)


def _slipped(strain: np.ndarray, way: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """Return strains (B, N+1, 2) after a way (n + 1, N+1, 2) of the elements."""
    for change in np.diff(way, axis=0):
        strain = memory.clipped(strain + change, slip)[0]
    return strain


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
