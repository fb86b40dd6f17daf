"""What the compiled loops of the dynamics work on: ropes, what drives them, and scratch.

The fields of the rod come from the table in `rod/fields.py`, those of a clip from `CLIP`.
"""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from ropefit.rod.fields import MOVING_ROD, Field, names
from ropefit.solvers.kernels.jit import maker

# Derivatives in what moves one clip of T times.
CLIP = (
    Field("ends", ("T", 2, 3), "m", "places of the ends"),
    Field("clamp", ("T", 2, 3), "rad", "turns of the clamps about their own axes"),
    Field("x0", ("N+1", 3), "m", "nodes at the start"),
    Field("v0", ("N+1", 3), "m/s", "their velocities"),
    Field("q0", ("N", 3), "rad", "turns of the frames at the start about their own directors"),
)

# One rope, or R ropes with one dimension more; rest is the whole quaternion (N+1, 4). gauge [N m]
# holds the spin of a rope that is free to spin, see `equilibrium/kernels/hessian.py`.
Rod = namedtuple("Rod", [*names(MOVING_ROD), "gauge"])
# Changes of a rope and of what moves it, or gradients in them; rest its vector part.
Change = namedtuple("Change", names((*MOVING_ROD, *CLIP)))


class Drive(NamedTuple):
    """What moves one clip of T times, or C clips: time (T,) [s], ends (T, 2, 3) [m], clamp
    (T, 2, 4); held (2,) whether each end's position is given."""

    time: np.ndarray
    ends: np.ndarray
    clamp: np.ndarray
    held: np.ndarray


class Work(NamedTuple):
    """Scratch of one step."""

    frame: np.ndarray  # R (N, 3, 3)
    u: np.ndarray  # force in the segment's own frame
    g: np.ndarray  # edge in it
    yields: np.ndarray  # l dΓ/du
    x: np.ndarray
    y: np.ndarray  # nodes without the forces in the segments
    inverse_mass: np.ndarray  # W (N+1,): z = y + W (n_k - n_{k-1})
    p: np.ndarray  # (N+1, 4)
    m: np.ndarray  # moment of each bend
    firm: np.ndarray  # its stiffness in this step
    pivot: np.ndarray  # (N, 6, 6) inverses
    off: np.ndarray  # (N, 3, 3)
    right: np.ndarray  # (N, 6)
    old_x: np.ndarray  # what D[x], D[v], D[p], D[Γ] take from the past
    old_v: np.ndarray
    old_p: np.ndarray
    old_strain: np.ndarray
    air: np.ndarray  # (N+1,) resistance of the air in this step
    drag: np.ndarray  # (N+1, 4) what it follows from, see `drag.py`
    ahead: np.ndarray  # (N+1, 3) the extrapolated speed, at which it is taken
    order: np.ndarray  # (6,) of the rows of a block
    rate: np.ndarray  # (N+1, 3) coefficients of D for each node, see `contact.py`
    z: np.ndarray  # (N+1, 3) nodes without the bodies that they touch
    body: np.ndarray  # (N+1,) which each touches, -1: none; of those that touch one:
    out: np.ndarray  # (N+1, 3, 3) dx/dz


@maker
def make_work(n):
    """Return scratch for n segments."""
    return Work(
        np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros(n + 1), np.zeros((n + 1, 4)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n, 6, 6)), np.zeros((n, 3, 3)),
        np.zeros((n, 6)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)),
        np.zeros((n, 3)), np.zeros(n + 1), np.zeros((n + 1, 4)), np.zeros((n + 1, 3)),
        np.zeros(6, np.int64), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.full(n + 1, -1),
        np.zeros((n + 1, 3, 3)),
    )  # fmt: skip


@maker
def work_of(w, k):
    """Return the scratch of clip k of C."""
    return Work(
        w.frame[k], w.u[k], w.g[k], w.yields[k], w.x[k], w.y[k], w.inverse_mass[k], w.p[k], w.m[k],
        w.firm[k], w.pivot[k], w.off[k], w.right[k], w.old_x[k], w.old_v[k], w.old_p[k],
        w.old_strain[k], w.air[k], w.drag[k], w.ahead[k], w.order[k], w.rate[k], w.z[k], w.body[k],
        w.out[k],
    )  # fmt: skip


@maker
def rod_of(rods, k):
    """Return rope k of R."""
    return Rod(
        rods.length[k], rods.flexibility[k], rods.stiffness[k], rods.rest[k], rods.load[k],
        rods.strain_viscosity[k], rods.bend_viscosity[k], rods.mass[k], rods.spring[k],
        rods.air[k], rods.drag[k], rods.bodies[k], rods.gauge[k],
    )  # fmt: skip


@maker
def drive_of(drives, k):
    """Return how clip k of C is driven."""
    return Drive(drives.time[k], drives.ends[k], drives.clamp[k], drives.held)


@maker
def change_of(c, k, of):
    """Return the change of clip k that shows rope `of`."""
    return Change(
        c.length[of], c.flexibility[of], c.stiffness[of], c.rest[of], c.load[of],
        c.strain_viscosity[of], c.bend_viscosity[of], c.mass[of], c.spring[of], c.air[of],
        c.drag[of], c.bodies[of], c.ends[k], c.clamp[k], c.x0[k], c.v0[k], c.q0[k],
    )  # fmt: skip
