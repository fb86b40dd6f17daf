"""Forward derivatives of simulated clips, for least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.fields import MOVING_ROD, names, shapes
from ropefit.solvers.dynamics.kernels.entries import tangent_clips
from ropefit.solvers.dynamics.kernels.records import CLIP, Change
from ropefit.solvers.dynamics.solve import Trajectory

OF_ROD = frozenset(names(MOVING_ROD))


class Directions(NamedTuple):
    """P directions of change for `tangent`; what is None does not change.

    Of R ropes, or one: the fields of `rod.fields.MOVING_ROD`, with a dimension of P between that of
    the ropes and their own: length (R, P, N). Of C clips, likewise: ends (C, P, T, 2, 3), clamp
    (C, P, T, 2, 3) as turns [rad] about the clamp's own axes, x0 and v0 (C, P, N+1, 3), q0
    (C, P, N, 3) as turns.
    """

    length: np.ndarray | None = None
    flexibility: np.ndarray | None = None
    strain_viscosity: np.ndarray | None = None
    stiffness: np.ndarray | None = None
    bend_viscosity: np.ndarray | None = None
    rest: np.ndarray | None = None
    load: np.ndarray | None = None
    mass: np.ndarray | None = None
    spring: np.ndarray | None = None
    air: np.ndarray | None = None
    drag: np.ndarray | None = None
    bodies: np.ndarray | None = None
    ends: np.ndarray | None = None
    clamp: np.ndarray | None = None
    x0: np.ndarray | None = None
    v0: np.ndarray | None = None
    q0: np.ndarray | None = None


def tangent(trajectory: Trajectory, directions: Directions, every: int = 1) -> np.ndarray:
    """Return forward derivatives of a converged trajectory, dx (C, P, T', N+1, 3) [m] per unit
    step, at every `every`-th of its T times from the first on."""
    problem = trajectory.problem
    clips, steps, n = trajectory.q.shape[:3]
    ropes = len(problem.rods.length)
    many = next(item.shape[1] for item in directions if item is not None)
    change = {}
    for name, shape in shapes((*MOVING_ROD, *CLIP), n, T=steps).items():
        given, rows = getattr(directions, name), ropes if name in OF_ROD else clips
        change[name] = np.zeros((rows, *shape, many))
        if given is not None:
            change[name][:] = np.moveaxis(given, 1, -1)
    dx = np.zeros((clips, many, (steps - 1) // every + 1, n + 1, 3))
    tangent_clips(
        *problem, trajectory.v0, trajectory.x, trajectory.q, np.nan_to_num(trajectory.force),
        Change(**change), every, dx,
    )  # fmt: skip
    return dx
