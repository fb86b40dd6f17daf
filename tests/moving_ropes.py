"""Ropes in motion that several tests use."""

from __future__ import annotations

import numpy as np

from ropefit.rod.moving import Damping, Moving, moving
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import Properties, build
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve

DOWN = np.array([0.0, 0.0, -9.81])
ALONG_X = np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # e3 to x


def damping(p: Properties, bend=0.0, twist=0.0, stretch=0.0, air=0.0) -> Damping:
    return Damping(*(v + 0 * p.length for v in (bend, twist, stretch, air)))


def rope(p: Properties, gravity=DOWN, clamped=(False, False), **coefficients) -> Moving:
    return moving(p, build(p, gravity, clamped), damping(p, **coefficients))


def hung(time: np.ndarray, clamp: np.ndarray | None = None) -> Drive:
    """One clip held at the origin by end 0, clamped there or not, the other end free."""
    steps = len(time)
    ends = np.full((1, steps, 2, 3), np.nan)
    ends[0, :, 0] = 0.0
    frames = np.full((1, steps, 2, 4), np.nan)
    if clamp is not None:
        frames[0, :, 0] = clamp
    return Drive(np.array(time)[None], ends, frames)


def in_plane(x: np.ndarray, v: np.ndarray | None = None) -> Start:
    """A start from nodes x (N+1, 3) in the plane of x and z; frames along the segments."""
    edge = np.diff(x, axis=0)
    angle = np.arctan2(edge[:, 0], edge[:, 2])
    q = from_rotation_vector(np.array([[0.0, a, 0.0] for a in angle]))
    v = np.zeros_like(x) if v is None else v
    return Start(x[None], q[None], v[None])


def stepped(*arguments) -> Trajectory:
    """A trajectory, which must have converged."""
    found = solve(*arguments)
    assert found.converged.all(), found.why()
    return found


def turned(frame, turn):
    """Frames turned about their own axes; arrays or tensors."""
    return multiply(frame, from_rotation_vector(turn))
