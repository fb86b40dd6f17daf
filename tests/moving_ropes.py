"""Ropes in motion that several tests use."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.rod.moving import Damping, Moving, moving
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import Properties, build
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import Trajectory, solve

DOWN = torch.tensor([0.0, 0.0, -9.81], dtype=torch.float64)
ALONG_X = torch.tensor([0.5**0.5, 0.0, 0.5**0.5, 0.0], dtype=torch.float64)  # e3 to x


def damping(p: Properties, bend=0.0, twist=0.0, stretch=0.0, air=0.0) -> Damping:
    return Damping(*(torch.full_like(p.length, v) for v in (bend, twist, stretch, air)))


def rope(p: Properties, gravity=DOWN, clamped=(False, False), **coefficients) -> Moving:
    return moving(p, build(p, gravity, clamped), damping(p, **coefficients))


def hung(time: np.ndarray, clamp: torch.Tensor | None = None) -> Drive:
    """One clip held at the origin by end 0, clamped there or not, the other end free."""
    steps = len(time)
    ends = torch.full((1, steps, 2, 3), torch.nan, dtype=torch.float64)
    ends[0, :, 0] = 0.0
    frames = torch.full((1, steps, 2, 4), torch.nan, dtype=torch.float64)
    if clamp is not None:
        frames[0, :, 0] = clamp
    return Drive(torch.from_numpy(np.array(time))[None], ends, frames)


def in_plane(x: np.ndarray, v: np.ndarray | None = None) -> Start:
    """A start from nodes x (N+1, 3) in the plane of x and z; frames along the segments."""
    edge = np.diff(x, axis=0)
    angle = np.arctan2(edge[:, 0], edge[:, 2])
    q = from_rotation_vector(torch.tensor([[0.0, a, 0.0] for a in angle], dtype=torch.float64))
    v = np.zeros_like(x) if v is None else v
    return Start(torch.from_numpy(x)[None], q[None], torch.from_numpy(v)[None])


def stepped(*arguments) -> Trajectory:
    """A trajectory, which must have converged."""
    found = solve(*arguments)
    assert found.converged.all(), found.why()
    return found


def turned(frame: torch.Tensor, turn: torch.Tensor) -> torch.Tensor:
    """Frames turned about their own axes."""
    return multiply(frame.expand(*turn.shape[:-1], 4), from_rotation_vector(turn))
