"""Friction that builds up, and fades, exponentially with the way of bending (Dahl, 1968).

Along a straight way the elastic part e of a vector v follows de = dv - e |dv| / range: a step d
from a strain e ends at

    e' = (range (1 - E) + E c) n + (1 - E) / x a,     x = |d| / range,  E = exp(-x),  n = d / |d|,

c being what of e is along n, a what is across. e' is the gradient in d of the potential

    range (1 - E) c + range² (x - 1 + E).

Along n that is Dahl's law, in steps of any size. Across, Dahl's law leaves E a: that is no
gradient, as an equilibrium's moment must be; here what is across fades half as fast in small steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

CLOSE = 1e-3  # ranges: steps below this take series
STILL = 1e-12  # ranges: steps of no direction


class Strained(NamedTuple):
    """After a step: strain (..., 2), its derivatives by_move and by_strain (..., 2, 2) and by_range
    (..., 2)."""

    strain: np.ndarray
    by_move: np.ndarray
    by_strain: np.ndarray
    by_range: np.ndarray


def strained(strain: np.ndarray, move: np.ndarray, reach: np.ndarray) -> Strained:
    """Return the strain after a step `move` (..., 2) from strain (..., 2), reach (...) being the
    range. Of no step, the derivative by it is the mean of both senses."""
    size = np.linalg.norm(move, axis=-1)
    x = size / reach
    still = x < STILL
    n = np.where(still[..., None], 0.0, move / np.maximum(size, 1e-300)[..., None])
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    along, across = (strain * n).sum(-1), (strain * t).sum(-1)
    gone = -np.expm1(-x)
    left = 1.0 - gone
    share = np.where(still, 1.0, gone / np.maximum(x, 1e-300))
    series = -0.5 + x / 3.0 - x * x / 8.0
    bend = np.where(x < CLOSE, series, (left - share) / np.maximum(x, CLOSE))
    nn, tt, nt = (a[..., :, None] * b[..., None, :] for a, b in ((n, n), (t, t), (n, t)))
    mixed = bend * across / reach
    unit = np.where(still[..., None, None], np.eye(2), 0.0)
    by_strain = left[..., None, None] * nn + share[..., None, None] * tt + unit
    by_move = (
        (left * (1.0 - along / reach))[..., None, None] * nn
        + (share + bend * along / reach)[..., None, None] * tt
        + mixed[..., None, None] * (nt + np.swapaxes(nt, -1, -2))
        + unit
    )
    after = np.einsum("...ij,...j->...i", by_strain, strain) + (reach * gone)[..., None] * n
    by_range = (gone - x * left + left * x * along / reach)[..., None] * n
    by_range = by_range - (bend * x * across / reach)[..., None] * t
    return Strained(after, by_move, by_strain, by_range)
