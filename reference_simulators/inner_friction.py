"""Friction inside a rope, in two dimensions, beside a linear spring `own`: of a spring constant
`more` and a range `slip`, as Prandtl has it, or Dahl (1968).

Dahl's elastic part e of a turn d changes along a straight way by de = dd - e |dd| / slip; its
moment is `more` e.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEPS = 40


def strained(d: Array, slip: float, held: Array) -> Array:
    """Return the elastic part (..., 2) after a turn d (..., 2) along a straight way, from `held`
    (..., 2)."""
    size = np.sqrt((d * d).sum(-1))[..., None]
    left = np.exp(-size / slip)
    return slip * (1 - left) * d / np.maximum(size, 1e-300) + left * held


def prandtl(left: Array, own: Array, more: float, slip: float) -> tuple[Array, Array]:
    """Return the turns d (..., 2) under moments left (..., 2), and the derivative (..., 2, 2): they
    are (own + more) d, or own d + more slip d/|d| where that is more. own (..., 1)."""
    size = np.sqrt((left * left).sum(-1))[..., None]
    slides = size > (own + more) * slip
    way = left / np.maximum(size, 1e-300)
    d = np.where(slides, (size - more * slip) / own * way, left / (own + more))
    outer = way[..., :, None] * way[..., None, :]
    across = np.where(slides, (size - more * slip) / (own * np.maximum(size, 1e-300)), 0.0)
    slope = np.where(
        slides[..., None],
        outer / own[..., None] + across[..., None] * (np.eye(2) - outer),
        np.eye(2) / (own + more)[..., None],
    )
    return d, slope


def dahl(left: Array, own: Array, more: float, slip: float, held: Array) -> tuple[Array, Array]:
    """Return the turns d (..., 2) at which own d + more strained(d) is the moment left (..., 2),
    and their derivative (..., 2, 2) by it. own (..., 1).

    Its size |d| is the root of a function that falls everywhere, sought by Newton's steps between
    bounds.
    """

    def pulled(e: Array) -> tuple[Array, Array]:
        pull = left - more * e * held
        return pull, np.sqrt((pull * pull).sum(-1))[..., None]

    high = pulled(np.ones(1))[1] / own
    low, size = np.zeros_like(high), 0.5 * high
    for _ in range(STEPS):
        e = np.exp(-size / slip)
        pull, far = pulled(e)
        over = far - own * size - more * slip * (1 - e)
        rate = more * e * (held * pull).sum(-1)[..., None] / (slip * np.maximum(far, 1e-300))
        low, high = np.where(over > 0, size, low), np.where(over > 0, high, size)
        step = size - over / (rate - own - more * e)
        step = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
        done, size = np.abs(step - size) <= 1e-13 * (slip + size), step
        if done.all():
            break
    e = np.exp(-size / slip)
    pull, far = pulled(e)
    way = pull / np.maximum(far, 1e-300)
    across = more * slip * (1 - e) / np.maximum(size, 1e-9 * slip)
    outer = way[..., :, None] * way[..., None, :]
    turn = more * e * (way - held / slip)
    rows = own[..., None] * np.eye(2) + across[..., None] * (np.eye(2) - outer)
    rows = rows + turn[..., :, None] * way[..., None, :]
    return size * way, np.asarray(np.linalg.inv(rows), dtype=np.float64)
