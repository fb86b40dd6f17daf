"""What the compiled loops of the equilibrium work on: a rope, what holds it, and scratch.

The fields of the rod come from the table in `rod/fields.py`, those of the conditions from `HELD`.
"""

from __future__ import annotations

from collections import namedtuple
from typing import NamedTuple

import numpy as np

from ropefit.rod.fields import ROD, TENSIONS, Field, names
from ropefit.solvers.kernels.jit import maker

# What holds a rope in one frame: S supports, B friction elements.
HELD = (
    Field("clamp", (2, 4), "1", "frames of the clamps"),
    Field("direction", ("S", 3), "1", "of each support"),
    Field("offset", ("S",), "m", "direction · x + compliance λ = offset"),
    Field("compliance", ("S",), "m/N", "of each support"),
    Field("active", ("S",), "", "which supports are there", np.bool_),
    Field("drag", ("B", "N+1"), "N m", "stiffness of the friction elements"),
    Field("centre", ("B", "N+1", 2), "1", "where they are unloaded"),
    Field("slip", ("B", "N+1"), "1", "length beyond which they slip, or their range"),
    Field("strain", ("B", "N+1", 2), "1", "at their centre, of those that build up gradually"),
    Field("gradual", ("B",), "", "which build up gradually (Dahl)", np.bool_),
    # A = 0: a strain in proportion to tension; else TENSIONS values.
    Field(
        "axial", ("A",), "1", "logarithm of the factor on axial flexibility, over that of tension"
    ),
)
# Derivatives in a frame's conditions, besides those in `ROD`.
HELD_GRADIENT = (
    Field("clamp", (2, 3), "rad", "turn about the clamp's own axes"),
    Field("anchor", (3,), "m", "place of node 0"),
    *(field for field in HELD if field.name in ("offset", "direction", "compliance")),
)

FLAT = 11  # columns of `Work.flat`

# One rope, or R ropes with one dimension more; rest is the whole quaternion (N+1, 4). gauge [N m]
# holds the spin of a rope that is free to spin, see `hessian.assemble`.
Rod = namedtuple("Rod", [*names(ROD), "gauge"])
# P directions in which a rope changes, every field (P, ...); rest its vector part.
Change = namedtuple("Change", names(ROD))
# Gradients of a loss in everything that decides one frame, or F frames.
Pull = namedtuple("Pull", names((*ROD, *HELD_GRADIENT)))
# One frame's conditions, or those of F frames: node (S,) of each support, common to all; free:
# whether nothing holds node 0.
Held = namedtuple("Held", ["node", "free", *names(HELD)])


class Work(NamedTuple):
    """Scratch of one rope. border (N, 3, S + extra): columns of the supports, last the
    residuals."""

    force: np.ndarray  # n, world
    u: np.ndarray
    g: np.ndarray
    yields: np.ndarray  # change of g by u (N, 3) [m/N]
    pull: np.ndarray  # axial strain over axial flexibility (N,) [N]: the tension, if linear
    stored: np.ndarray  # of a law of axial strain, see `axial.set_stored`
    frame: np.ndarray  # R (N, 3, 3)
    x: np.ndarray
    give: np.ndarray  # of the nodes to forces, frames held (N+1, 6) [m/N], see `set_corner`
    p: np.ndarray  # Darboux quaternion of each bend element
    m: np.ndarray  # its moment
    k: np.ndarray  # its stiffness, with the friction elements
    coupling: np.ndarray  # its stiffness between bending about the first and the second director
    diagonal: np.ndarray
    off: np.ndarray
    inverse: np.ndarray
    border: np.ndarray
    solved: np.ndarray
    corner: np.ndarray  # second derivative of L in (λ, x_0)
    rest: np.ndarray  # residual of the supports and of the total force
    schur: np.ndarray  # what is left of the corner once the turns are eliminated
    right: np.ndarray  # forces of the supports and moves of node 0 (S + 3, extra)
    along: np.ndarray  # force and move at a segment, in each direction of change (6, extra)
    small: np.ndarray  # of `small_matrices` (S + 5, S + 3)
    block: np.ndarray
    turn: np.ndarray  # of each segment (N, 3) [rad]
    sums: np.ndarray  # over the nodes beyond each segment (N, 3)
    trial: np.ndarray  # frames (N, 4) of a step that is tried
    trial_x: np.ndarray  # its place of node 0
    trial_lam: np.ndarray  # its forces of the supports
    gaps: np.ndarray  # its residual, as `rest`
    flat: np.ndarray  # of Newton's method in a plane, see `planar.py`


@maker
def make_work(n, s, extra):
    """Return scratch for n segments, s supports and `extra` right hand sides."""
    return Work(
        np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n),
        np.zeros(TENSIONS), np.zeros((n, 3, 3)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 6)), np.zeros((n + 1, 4)), np.zeros((n + 1, 3)),
        np.zeros((n + 1, 3)), np.zeros(n + 1), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)),
        np.zeros((n, 3, 3)),
        np.zeros((n, 3, s + extra)), np.zeros((n, 3, s + extra)), np.zeros((s + 3, s + 3)),
        np.zeros(s + 3), np.zeros((s + 3, s + 3)), np.zeros((s + 3, extra)),
        np.zeros((6, extra)), np.zeros((s + 5, s + 3)), np.zeros((3, 3)), np.zeros((n, 3)),
        np.zeros((n, 3)), np.zeros((n, 4)), np.zeros(3), np.zeros(s), np.zeros(s + 3),
        np.zeros((n, FLAT)),
    )  # fmt: skip


@maker
def rod_of(rods, k):
    """Return rope k of R."""
    return Rod(
        rods.length[k], rods.flexibility[k], rods.stiffness[k], rods.rest[k], rods.load[k],
        rods.moment[k], rods.gauge[k],
    )  # fmt: skip


@maker
def change_of(changes, k):
    """Return the directions of rope k of R."""
    return Change(
        changes.length[k], changes.flexibility[k], changes.stiffness[k], changes.rest[k],
        changes.load[k], changes.moment[k],
    )  # fmt: skip


@maker
def held_in(held, t):
    """Return the conditions of frame t of F."""
    return Held(
        held.node, held.free, held.clamp[t], held.direction[t], held.offset[t],
        held.compliance[t], held.active[t], held.drag[t], held.centre[t], held.slip[t],
        held.strain[t], held.gradual[t], held.axial[t],
    )  # fmt: skip


@maker
def pull_in(pulls, t):
    """Return the gradients of frame t of F."""
    return Pull(
        pulls.length[t], pulls.flexibility[t], pulls.stiffness[t], pulls.rest[t], pulls.load[t],
        pulls.moment[t], pulls.clamp[t], pulls.anchor[t], pulls.direction[t], pulls.offset[t],
        pulls.compliance[t],
    )  # fmt: skip
