"""Unit quaternions w x y z as numpy arrays (..., 4): the few maps that exporters need."""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (..., 4) Hamilton product p q."""
    pw, pv = p[..., :1], p[..., 1:]
    qw, qv = q[..., :1], q[..., 1:]
    real = pw * qw - (pv * qv).sum(-1, keepdims=True)
    return np.concatenate([real, pw * qv + qw * pv + np.cross(pv, qv)], axis=-1)


def conjugate(q: np.ndarray) -> np.ndarray:
    """Return (..., 4) the inverse of a unit quaternion."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return (..., 3) R(q) v."""
    axis = q[..., 1:]
    across = 2 * np.cross(axis, v)
    return v + q[..., :1] * across + np.cross(axis, across)


def matrix(q: np.ndarray) -> np.ndarray:
    """Return (..., 3, 3) R(q); its columns are the material axes e1, e2, e3."""
    return np.stack([rotate(q, axis) for axis in np.eye(3)], axis=-1)


def from_vector(v: np.ndarray) -> np.ndarray:
    """Return (..., 4) the rotation by |v| radians about v (..., 3)."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * v], axis=-1)


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return (4,) the smallest rotation that takes direction a (3,) to direction b (3,)."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    q = np.concatenate([[1 + a @ b], np.cross(a, b)])
    if np.linalg.norm(q) < 1e-6:  # opposite: any axis across a
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        q = np.concatenate([[0.0], across])
    return q / np.linalg.norm(q)


def transport(first: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Return (N, 4) frames without twist along unit tangents (N, 3), the first as near `first` (4,)
    as can be."""
    frames = [multiply(between(rotate(first, np.array([0.0, 0, 1])), tangents[0]), first)]
    for a, b in pairwise(tangents):
        frames.append(multiply(between(a, b), frames[-1]))
    return np.array(frames)
