"""Where a solve starts: the catenary through the ends, or a straight rope where an end is free."""

from __future__ import annotations

import numpy as np
import torch
from scipy.optimize import brentq
from torch import Tensor

from ropefit.rod.quaternion import transport


def hanging_shape(
    length: float, nodes: int, gravity: np.ndarray, ends: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """(K, 3) [m] centreline evenly spaced in arc length, in equilibrium if the rope had no
    stiffness.

    ends, tangents: (2, 3), NaN where free or unclamped. Both ends: catenary (straight when taut; an
    arbitrary plane when one end hangs exactly above the other). One end: straight along its
    tangent, or down. Raises ValueError when both are free.
    """
    held = np.asarray(np.isfinite(ends).all(axis=1))
    clamped = np.asarray(np.isfinite(tangents).all(axis=1))
    arc = np.linspace(0.0, length, nodes)
    size = np.linalg.norm(gravity)
    down = gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
    if not held.any():
        raise ValueError("a rope with two free ends has no place to start from")
    if held.all():
        return _catenary(length, arc, down, ends)
    end = int(np.argmax(held))
    forward = tangents[end] if clamped[end] else (down if end == 0 else -down)
    along = arc if end == 0 else arc - length
    return ends[end] + along[:, None] * forward


def _catenary(length: float, arc: np.ndarray, down: np.ndarray, ends: np.ndarray) -> np.ndarray:
    chord = ends[1] - ends[0]
    span = np.linalg.norm(chord)
    if span >= length * (1 - 1e-9):
        return ends[0] + np.linspace(0, 1, arc.size)[:, None] * chord
    rise = float(chord @ -down)
    flat = chord + rise * down
    horizontal = float(np.linalg.norm(flat))
    # Nearly above each other: open the fold by a thousandth of the length in some direction.
    least = 1e-3 * length
    if horizontal < least:
        axis = np.eye(3)[int(np.argmin(np.abs(down)))]
        across = np.cross(down, axis)
        flat = flat if horizontal > 1e-12 * length else across / np.linalg.norm(across)
    ahead = flat / np.linalg.norm(flat)
    width = max(horizontal, least)
    # sinh(u)/u = ratio for u = width / (2 a), a the catenary's parameter.
    slack = max(length**2 - rise**2, width**2 * (1 + 1e-12))
    ratio = np.sqrt(slack) / width

    def excess(v: float) -> float:
        return np.log(np.sinh(v) / v) - np.log(ratio)

    u = float(brentq(excess, 1e-7, 30 + 2 * np.log(ratio)))  # type: ignore[arg-type]
    a = width / (2 * u)
    lowest = (length - rise / np.tanh(u)) / 2  # arc length from end 0 to the lowest point
    along = a * (np.arcsinh((arc - lowest) / a) - np.arcsinh(-lowest / a))
    height = np.hypot(a, arc - lowest) - np.hypot(a, lowest)
    shape = ends[0] + along[:, None] * ahead - height[:, None] * down
    miss = ends[1] - shape[-1]  # only where the fold was opened
    return shape + (arc / length)[:, None] * miss


def frames_along(x: Tensor, first: Tensor | None = None, last: Tensor | None = None) -> Tensor:
    """(..., K-1, 4) twist-free frames of a centreline x (..., K, 3), clamps put in their places.

    first, last: (..., 4) held frames of the first and last segment, NaN where not held. The frames
    run from the first clamp if there is one, so that their arbitrary turn about the tangent is the
    clamp's.
    """
    edges = x[..., 1:, :] - x[..., :-1, :]
    norm = torch.sqrt((edges * edges).sum(-1, keepdim=True) + 1e-24)
    tangents = edges / norm
    fallback = torch.zeros_like(tangents)
    fallback[..., 2] = 1.0
    tangents = torch.where(norm > 1e-11, tangents, fallback)
    q = transport(tangents)
    for index, held in ((0, first), (-1, last)):
        if held is not None:
            given = torch.isfinite(held).all(-1, keepdim=True)
            near = q[..., index, :]
            held = torch.where(given, held, near)
            sign = torch.where((held * near).sum(-1, keepdim=True) < 0, -1.0, 1.0)
            place = torch.zeros(q.shape[-2], 1, dtype=torch.bool)
            place[index] = True
            q = torch.where(place, (sign * held)[..., None, :], q)
    return q
