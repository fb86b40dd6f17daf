"""Curves of known arc length and clouds about them, for the tests of perception."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

DENSE = 4001


def by_length(curve: np.ndarray, length: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """(arc (N,), curve (N, 3)) [m] of a curve scaled to the given length."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    return arc * length / arc[-1], curve * length / arc[-1]


def bent(radius: float, turn: float, length: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Straight, an arc of `radius` [m] through `turn` [rad], straight again, in the plane y = 0."""
    s = np.linspace(0, length, DENSE)
    angle = np.clip((s - (length - radius * turn) / 2) / radius, 0, turn) - turn / 2
    middle = (angle[1:] + angle[:-1]) / 2
    step = s[1] * np.column_stack([np.cos(middle), 0 * middle, np.sin(middle)])
    return s, np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])


def straight(direction: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A straight metre from the origin."""
    share = np.linspace(0, 1, DENSE)
    return share, share[:, None] * np.array(direction)


def shapes() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ropes of one metre, by name."""
    u = np.linspace(0, 1, DENSE)
    helix = [0.12 * np.cos(7.5 * u), 0.12 * np.sin(7.5 * u), -0.4 * u]
    return {
        "helix": by_length(np.column_stack(helix)),
        "s-curve": by_length(np.column_stack([u, 0 * u, 0.25 * np.sin(2 * np.pi * u)])),
        "u-turn": bent(0.02, np.pi),  # legs 4 cm apart
        "level": straight((1, 0, 0)),
        "vertical": straight((0, 0, -1)),
    }


def cloud(
    arc: np.ndarray,
    curve: np.ndarray,
    count: int,
    rng: np.random.Generator,
    radius: float = 0.003,
    noise: float = 0.001,
    eye: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(points (count, 3), their true arc (count,)) [m] on a tube; with `eye` (3,) on the side that
    faces it."""
    at = rng.integers(0, len(arc), count)
    tangent = np.gradient(curve, axis=0)[at]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    out = rng.normal(size=(count, 3))
    out -= (out * tangent).sum(axis=1, keepdims=True) * tangent
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    if eye is not None:
        away = (out * (eye - curve[at])).sum(axis=1) < 0
        across = np.cross(tangent, eye - curve[at])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        # Mirrored about the plane of the tangent and of what is square to the sight.
        normal = np.cross(across, tangent)
        flipped = out - 2 * (out * normal).sum(axis=1, keepdims=True) * normal
        out[away] = flipped[away]
    return curve[at] + radius * out + noise * rng.normal(size=(count, 3)), arc[at]


def nearest(curve: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(distance (N,), index (N,)) of the nearest vertex of a curve to points (N, D)."""
    distance, index = KDTree(curve).query(points)
    return np.asarray(distance), np.asarray(index)
