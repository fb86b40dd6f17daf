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
BENT = 0.008  # of the largest curvature: how exactly what has slipped there is followed
MOST_INCREMENTS = 6  # from one frame to the next
SHARES = 1, 2, 3  # increments, of which the most are a multiple


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
        strides = _rubbed(whole, rough, without_past(out).x)
        out = np.maximum(out, np.clip(np.ceil(strides), 1, MOST_INCREMENTS).astype(int))
    if _slips(law).any():
        fine = without_past(np.where(begins, 1, MOST_INCREMENTS))
        out = np.maximum(out, _bent(law, fine, begins, spins))
    return np.where(begins, 1, out)


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


def _slips(law: Laws) -> np.ndarray:
    """Return which branches (B,) slip at a limit."""
    return (law.drag > 0).any(axis=1) & np.isfinite(law.slip).all(axis=1) & ~law.gradual


def _bent(law: Laws, fine: Solution, begins: np.ndarray, spins: bool) -> np.ndarray:
    """Return (H,) in how many increments each frame is reached so that what slips on the way, which
    is that of the `fine` frames, ends where it does in the most."""
    sharp, out = _slips(law), np.ones(len(begins), dtype=int)
    rest, stiffness = (
        a.reshape(-1, law.drag.shape[1], 3)[0] for a in (fine.rod.rest, fine.rod.stiffness)
    )
    slip, v, unloaded = law.slip[sharp], vectors(fine) @ [1, 1j], rest[:, :2] @ [1, 1j]
    with np.errstate(divide="ignore", invalid="ignore"):
        least = BENT * np.nanmax(np.abs(v - unloaded)) * stiffness[:, 0] / law.drag[sharp]
    least = np.nan_to_num(least, nan=np.inf, posinf=np.inf)  # where nothing bends
    settled = np.flatnonzero(np.isfinite(v).all(axis=1)) if spins else []
    for before, t in pairwise(settled):
        v[t] *= np.exp(1j * np.angle(np.vdot(v[t], v[before])))
    strain, last = np.zeros_like(slip, dtype=complex), 0
    for t, first in enumerate(begins):
        if first:
            strain = _clipped(np.where(law.fresh[sharp, None], v[last] - unloaded, 0.0), slip)
            last += 1
            continue
        way = v[last - 1 : last + MOST_INCREMENTS]
        exact, last = _led(strain, way, slip), last + MOST_INCREMENTS
        errors = (
            (parts, np.abs(_led(strain, way[:: MOST_INCREMENTS // parts], slip) - exact))
            for parts in SHARES
        )
        fine_enough = (parts for parts, error in errors if (error <= least).all())
        out[t] = next(fine_enough, MOST_INCREMENTS)
        strain = np.where(np.isfinite(exact), exact, strain)
    return out


def _led(strain: np.ndarray, way: np.ndarray, slip: np.ndarray) -> np.ndarray:
    """Return strains (B, N+1) in the complex plane after a way (n + 1, N+1) of the elements."""
    for change in np.diff(way, axis=0):
        strain = _clipped(strain + change, slip)
    return strain


def _clipped(strain: np.ndarray, slip: np.ndarray) -> np.ndarray:
    return strain * np.minimum(1.0, slip / np.maximum(np.abs(strain), 1e-300))


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
