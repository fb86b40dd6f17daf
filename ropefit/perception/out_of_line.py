"""Markers that are not where the rest of the rope puts them, in poses too far apart to follow."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

JUMP = 0.03  # m that a marker is off what its neighbours allow
EACH_SIDE = 2  # neighbours along the rope that tell where a marker is: a cubic
LEAST_NEIGHBOURS = 3  # neighbours; fewer allow anything
STRETCH = 3e-3  # m that it is farther from one beside it than usual
ONE_SIDED = 0.5  # of the distance to the nearest: an end may bend as it does nowhere else


class _Off(NamedTuple):
    """Of a marker by its neighbours' curve: (F,) distances [m], what is usual, what is a jump, and
    the weight of the positions that the distance is made of."""

    distance: np.ndarray
    usual: float
    jump: float
    weight: float


def out_of_line(positions: np.ndarray) -> np.ndarray:
    """Return (F, M) sizes [m] of jumps of markers (F, M, 3) [m], NaN where unseen; 0 of no jump.

    A marker jumps where it is both off and apart: farther from a polynomial of the arc length
    through its nearest neighbours than it usually is in all frames, by JUMP, and farther from one
    beside it than usual, by STRETCH. (A bend takes a marker off that curve as well, but brings it
    nearer to its neighbours.) Of several such markers, that is left out without which the
    others are off least.
    """
    sizes = np.zeros(positions.shape[:2])
    chord = np.linalg.norm(np.diff(positions, axis=1), axis=2)
    if positions.shape[1] <= LEAST_NEIGHBOURS or not np.isfinite(chord).any():
        return sizes
    chord = np.where(np.isfinite(chord).any(axis=0), chord, np.nanmedian(chord))
    place = np.concatenate([[0.0], np.cumsum(np.nanmedian(chord, axis=0))])

    @cache
    def off(marker: int, neighbours: tuple[int, ...]) -> _Off:
        return _off_curve(positions, place, marker, list(neighbours))

    def among(frame: int, seen: np.ndarray) -> tuple[list[int], float]:
        """Return the markers of those seen (M,) that jump, and how far [m] all are off."""
        jumping, total = [], 0.0
        for marker in np.flatnonzero(seen):
            near = _neighbours(seen, marker)
            if len(near) < LEAST_NEIGHBOURS:
                continue
            of = off(int(marker), near)
            total += max(float(of.distance[frame]) - of.usual, 0.0) / of.weight
            if of.distance[frame] > of.jump and _apart(positions[frame], place, seen, marker):
                jumping.append(int(marker))
        return jumping, total

    whole = np.asarray(np.isfinite(positions).all(axis=2))
    for frame in range(len(positions)):
        seen = whole[frame]
        jumping, _ = among(frame, seen)
        while jumping:
            left = {m: among(frame, seen & (np.arange(len(seen)) != m)) for m in jumping}
            worst = min(left, key=lambda marker: left[marker][1])
            sizes[frame, worst] = off(worst, _neighbours(seen, worst)).distance[frame]
            seen[worst], jumping = False, left[worst][0]
    return sizes


def _off_curve(positions: np.ndarray, place: np.ndarray, marker: int, near: list[int]) -> _Off:
    """Compare a marker in all frames with the polynomial through its neighbours."""
    at = place[near]
    with np.errstate(all="ignore"):
        weights = [np.prod((place[marker] - np.delete(at, k)) / (x - np.delete(at, k)))
                   for k, x in enumerate(at)]  # fmt: skip
    curve = np.einsum("n,fnx->fx", weights, positions[:, near])
    distance = np.linalg.norm(positions[:, marker] - curve, axis=1)
    known = distance[np.isfinite(distance)]
    usual = float(np.median(known)) if known.size else np.inf
    bends = 0.0
    if not min(near) < marker < max(near):
        bends = ONE_SIDED * float(np.abs(at - place[marker]).min())
    return _Off(distance, usual, usual + bends + JUMP, float(np.linalg.norm([1.0, *weights])))


def _apart(points: np.ndarray, place: np.ndarray, seen: np.ndarray, marker: int | np.intp) -> bool:
    """Return whether a marker of (M, 3) [m] is farther from one beside it than it usually is."""
    others = np.flatnonzero(seen)
    beside = [*others[others < marker][-1:], *others[others > marker][:1]]
    chord = np.linalg.norm(points[beside] - points[marker], axis=1)
    return bool((chord - np.abs(place[beside] - place[marker])).max() > STRETCH)


def _neighbours(seen: np.ndarray, marker: int | np.intp) -> tuple[int, ...]:
    """Return the seen markers (M,) next to a marker: two on each side, or three where it ends."""
    others = np.flatnonzero(seen)
    left, right = others[others < marker][::-1], others[others > marker]
    if len(left) < EACH_SIDE:
        right = right[: LEAST_NEIGHBOURS - len(left)]
    elif len(right) < EACH_SIDE:
        left = left[: LEAST_NEIGHBOURS - len(right)]
    else:
        left, right = left[:EACH_SIDE], right[:EACH_SIDE]
    return tuple(int(m) for m in (*left, *right))
