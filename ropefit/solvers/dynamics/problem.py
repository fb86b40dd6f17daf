"""Ropes in motion and what drives them, and both as the compiled solver takes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.either import Array
from ropefit.rod.fields import MOVING_ROD
from ropefit.rod.moving import Moving
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.dynamics.kernels.records import Drive as DriveArrays
from ropefit.solvers.dynamics.kernels.records import Rod as RodArrays
from ropefit.solvers.rods import check_rods, every_row, free_to_spin, rod_rows, whole_rest
from ropefit.solvers.shapes import check_indices, check_shapes

GAUGE, FREE_GAUGE = 1e-9, 1e-4  # of the largest stiffness: holds a rope that is free to spin


class Drive(NamedTuple):
    """C clips of T times. time (C, T) [s], increasing; ends (C, T, 2, 3) [m], NaN for an end that
    is free, and clamp (C, T, 2, 4), NaN where not clamped (which ends are is the same in all)."""

    time: Array
    ends: Array
    clamp: Array

    def clips(self, index: np.ndarray) -> Drive:
        """Return some of the clips."""
        return Drive(self.time[index], self.ends[index], self.clamp[index])


class Start(NamedTuple):
    """The first state: x (C, N+1, 3) [m], q (C, N, 4), v (C, N+1, 3) [m/s]."""

    x: Array
    q: Array
    v: Array


class Problem(NamedTuple):
    """R ropes, which of them each of C clips shows (C,), and how their ends are driven."""

    rods: RodArrays
    of: np.ndarray
    drives: DriveArrays


def problem_of(rope: Moving, drive: Drive, member: np.ndarray | None) -> Problem:
    """Return the problem of ropes and of how they are driven; member (C,) as in `solve`.

    Raises ValueError for what the dynamics does not do, ShapeError where the arrays do not belong
    together.
    """
    rows = ropes_in_motion(rope)
    arrays = {name: every_row(array, len(rows.gauge)) for name, array in rows._asdict().items()}
    ends = as_numpy(drive.ends)
    held = np.array([not np.isnan(ends[:, :, end]).any() for end in range(2)])
    drives = DriveArrays(
        as_numpy(drive.time), np.nan_to_num(ends), np.nan_to_num(as_numpy(drive.clamp)), held
    )
    return Problem(RodArrays(**arrays), shown(len(rows.gauge), len(ends), member), drives)


def ropes_in_motion(rope: Moving) -> RodArrays:
    """Return R ropes as the compiled solver takes them; what is the same in all has one row.

    Raises ValueError for moments at the ends, which the dynamics does not know.
    """
    if rope.rod.moment.any():
        raise ValueError("moments at the ends have no place in the dynamics")
    rows = rod_rows(rope.rod._asdict() | rope._asdict(), MOVING_ROD)
    stiffness, rest = rows["stiffness"], rows["rest"]
    # Where bending is damped, spinning is not quite free, and the matrix must be that of it; where
    # it is free, rounding must not turn the rope by more than an iteration may.
    small = np.where(rows["bend_viscosity"].any((1, 2)), GAUGE, FREE_GAUGE)
    largest = stiffness.max(axis=(1, 2), initial=1e-9)
    gauge = np.where(free_to_spin(stiffness, rest), small * largest, 0.0)
    gauge = every_row(gauge, max(map(len, rows.values())))
    return RodArrays(**(rows | {"rest": whole_rest(rest)}), gauge=gauge)


def shown(ropes: int, clips: int, member: np.ndarray | None) -> np.ndarray:
    """Return (C,) which rope each clip shows; member as in `solve`. Raises ValueError."""
    if member is None:
        if ropes not in (1, clips):
            raise ValueError(f"{ropes} ropes for {clips} clips: say which clip shows which")
        member = np.zeros(clips, np.int64) if ropes == 1 else np.arange(clips)
    return np.ascontiguousarray(member, dtype=np.int64)


def check_clips(problem: Problem) -> None:
    """Check ropes in motion and how the ends of C clips are driven. Raises ShapeError."""
    rods, of, drives = problem
    clips, steps = drives.time.shape
    check_rods(rods, MOVING_ROD)
    check_shapes(
        of=(of, (clips,)),
        ends=(drives.ends, (clips, steps, 2, 3)),
        clamp=(drives.clamp, (clips, steps, 2, 4)),
        held=(drives.held, (2,)),
    )
    check_indices("of", of, len(rods.length))
