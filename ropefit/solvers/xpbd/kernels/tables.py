"""The tables of the compiled loops: their columns, and small vectors in them as tuples.

Everything about a rope is a table with a row for each of its K particles; row i also holds segment
i (to particle i + 1), its frame, and the bend-twist pair of frames i and i + 1. The names below are
the columns; `v3(table, i, SHEAR)` reads three of them. "Change" is that of a multiplier, eq. (3).
"""

from __future__ import annotations

from typing import NamedTuple

from ropefit.solvers.kernels.jit import exact_helper

# State of a rope, or its adjoint: x [m], q, and the multipliers of the running step.
X, Q, SHEAR, BEND, DISTANCE, STATE_COLUMNS = 0, 3, 7, 10, 13, 14
# One iteration: changes of the multipliers; |q| before it was made 1 again.
C_SHEAR, C_BEND, C_DISTANCE, Q_NORM, CHANGE_COLUMNS = 0, 3, 6, 7, 8
# Scratch: move of x and turn of q in one iteration; length and direction of the segments; factors
# of Thomas; for the adjoint, that of the state after (PULL) and of direction and change.
MOVE, TURN, EDGE, DIRECTION, PIVOT, RATIO, WORK_COLUMNS = 0, 3, 7, 8, 11, 12, 24
PULL_X, PULL_Q, G_DIRECTION, G_CHANGE = 13, 16, 20, 23
# Constants. SHARE: inverse mass over the number of constraints that touch a particle or frame, but
# SHARE_D, for the distance, the inverse mass alone with Thomas. INVERSE: 1 / denominators of
# eq. (3); DIAGONAL: of the distance system. FALL: g dt² / 2 [m], zero for held particles.
LENGTH, WEIGHT, SHARE, SHARE_D, WEIGHT_Q, SHARE_Q, DIAGONAL = 0, 1, 2, 3, 4, 5, 6
INVERSE_SHEAR, INVERSE_BEND, FALL, DARBOUX, ROD_COLUMNS = 7, 8, 9, 12, 16


class Options(NamedTuple):
    """Compliances, eq. (3); tiny [m²] keeps coincident particles apart; iterations in a step."""

    alpha_shear: float
    alpha_bend: float
    alpha_distance: float
    tiny: float
    thomas: bool
    iterations: int
    total: int


class Weights(NamedTuple):
    """The η of one rope, times η^SOR / 2; η_x^G has its own argument."""

    distance: float
    shear_x: float
    shear_q: float
    bend: float


@exact_helper
def v3(a, i, j):
    return a[i, j], a[i, j + 1], a[i, j + 2]


@exact_helper
def v4(a, i, j):
    return a[i, j], a[i, j + 1], a[i, j + 2], a[i, j + 3]


@exact_helper
def put3(a, i, j, v):
    a[i, j], a[i, j + 1], a[i, j + 2] = v


@exact_helper
def add3(a, i, j, f, v):
    """Add to row i from column j: a += f v."""
    a[i, j] += f * v[0]
    a[i, j + 1] += f * v[1]
    a[i, j + 2] += f * v[2]


@exact_helper
def add4(a, i, j, f, v):
    add3(a, i, j, f, v)
    a[i, j + 3] += f * v[3]


@exact_helper
def fill(a, value):
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            a[i, j] = value


@exact_helper
def scale(f, a):
    return f * a[0], f * a[1], f * a[2]


@exact_helper
def mix(f, a, g, b):
    """Return f a + g b."""
    return f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2]


@exact_helper
def dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@exact_helper
def dot4(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
