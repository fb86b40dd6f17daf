"""Algorithm 1 for one rope after the other in compiled loops, and its reverse-mode derivative.

The same mathematics as `xpbd.py`, which is the reference. Everything about a rope is a table with a
row for each of its K particles; row i also holds segment i (to particle i + 1), its frame, and the
bend-twist pair of frames i and i + 1. The names below are the columns of the tables; `v3(table, i,
SHEAR)` reads three of them. "Change" is that of a multiplier, eq. (3). G(q) is the gradient of the
third director, N(c) = Σ c_a B_a, antisymmetric, with the forms B of the Darboux quaternion.

All compiled code is in this one file, because numba's cache notices only changes of the file that
holds the entry points, `run_ropes` and `pull_ropes`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

helper = njit(error_model="numpy")  # division by zero gives inf or NaN, as in torch
kernel = njit(cache=True, nogil=True, error_model="numpy")

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


# --- Small vectors as tuples ---------------------------------------------------------------------


@helper
def v3(a, i, j):
    return a[i, j], a[i, j + 1], a[i, j + 2]


@helper
def v4(a, i, j):
    return a[i, j], a[i, j + 1], a[i, j + 2], a[i, j + 3]


@helper
def put3(a, i, j, v):
    a[i, j], a[i, j + 1], a[i, j + 2] = v


@helper
def add3(a, i, j, f, v):
    """Row i from column j: a += f v."""
    a[i, j] += f * v[0]
    a[i, j + 1] += f * v[1]
    a[i, j + 2] += f * v[2]


@helper
def add4(a, i, j, f, v):
    add3(a, i, j, f, v)
    a[i, j + 3] += f * v[3]


@helper
def fill(a, value):
    for i in range(a.shape[0]):
        for j in range(a.shape[1]):
            a[i, j] = value


@helper
def copy(source, target):
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@helper
def scale(f, a):
    return f * a[0], f * a[1], f * a[2]


@helper
def mix(f, a, g, b):
    """f a + g b."""
    return f * a[0] + g * b[0], f * a[1] + g * b[1], f * a[2] + g * b[2]


@helper
def dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def dot4(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@helper
def director_product(q, v):
    """G(q) v, 3 numbers; symmetric in q and v. The third director is G(q) q / 2."""
    return (
        2 * (q[2] * v[0] + q[3] * v[1] + q[0] * v[2] + q[1] * v[3]),
        2 * (-q[1] * v[0] - q[0] * v[1] + q[3] * v[2] + q[2] * v[3]),
        2 * (q[0] * v[0] - q[1] * v[1] - q[2] * v[2] + q[3] * v[3]),
    )


@helper
def director_pull(c, q):
    """G(q)^T c, 4 numbers; a symmetric matrix times q."""
    return (
        2 * (c[0] * q[2] - c[1] * q[1] + c[2] * q[0]),
        2 * (c[0] * q[3] - c[1] * q[0] - c[2] * q[1]),
        2 * (c[0] * q[0] + c[1] * q[3] - c[2] * q[2]),
        2 * (c[0] * q[1] + c[1] * q[2] + c[2] * q[3]),
    )


@helper
def imaginary(p, r):
    """Im(p* r), 3 numbers: p^T B_a r."""
    return (
        p[0] * r[1] - p[1] * r[0] - p[2] * r[3] + p[3] * r[2],
        p[0] * r[2] - p[2] * r[0] - p[3] * r[1] + p[1] * r[3],
        p[0] * r[3] - p[3] * r[0] - p[1] * r[2] + p[2] * r[1],
    )


@helper
def darboux_pull(c, r):
    """N(c) r, 4 numbers: gradient of c · Im(p* r) with respect to p; -N(c) p is that for r."""
    return (
        c[0] * r[1] + c[1] * r[2] + c[2] * r[3],
        -c[0] * r[0] + c[1] * r[3] - c[2] * r[2],
        -c[0] * r[3] - c[1] * r[0] + c[2] * r[1],
        c[0] * r[2] - c[1] * r[1] - c[2] * r[0],
    )


# --- The three constraints -----------------------------------------------------------------------
# Each project_* sets the change, adds it to the multiplier, and its weighted move to the scratch.
# Each *_adjoint adds to g, the adjoint of the state before, and returns (move without its weight) ·
# pull, which is the derivative by the weight; pull is the adjoint of the state after.


@helper
def project_shear(s, rod, options, weights, change, work):
    """C^S = e / l - G(q) q / 2, eq. (5)."""
    for i in range(len(s) - 1):
        q, length = v4(s, i, Q), rod[i, LENGTH]
        edge = mix(1.0, v3(s, i + 1, X), -1.0, v3(s, i, X))
        value = mix(1 / length, edge, -0.5, director_product(q, q))
        value = mix(1.0, value, options.alpha_shear, v3(s, i, SHEAR))
        c = scale(-rod[i, INVERSE_SHEAR], value)
        put3(change, i, C_SHEAR, c)
        add3(s, i, SHEAR, 1.0, c)
        add3(work, i, MOVE, -weights.shear_x * rod[i, SHARE] / length, c)
        add3(work, i + 1, MOVE, weights.shear_x * rod[i + 1, SHARE] / length, c)
        add4(work, i, TURN, -weights.shear_q * rod[i, WEIGHT_Q], director_pull(c, q))


@helper
def project_shear_adjoint(g, rod, options, weights, before, change, work):
    dot_x, dot_q = 0.0, 0.0
    for i in range(len(g) - 1):
        q, c, pull = v4(before, i, Q), v3(change, i, C_SHEAR), v4(work, i, PULL_Q)
        first, second = rod[i, SHARE] / rod[i, LENGTH], rod[i + 1, SHARE] / rod[i, LENGTH]
        by_move = mix(second, v3(work, i + 1, PULL_X), -first, v3(work, i, PULL_X))
        by_turn = scale(-rod[i, WEIGHT_Q], director_product(q, pull))
        dot_x += dot3(c, by_move)
        dot_q += dot3(c, by_turn)
        g_change = mix(weights.shear_x, by_move, weights.shear_q, by_turn)
        g_change = mix(1.0, g_change, 1.0, v3(g, i, SHEAR))
        g_value = scale(-rod[i, INVERSE_SHEAR], g_change)
        add3(g, i, SHEAR, options.alpha_shear, g_value)
        add3(g, i, X, -1 / rod[i, LENGTH], g_value)
        add3(g, i + 1, X, 1 / rod[i, LENGTH], g_value)
        add4(g, i, Q, -1.0, director_pull(g_value, q))
        add4(g, i, Q, -weights.shear_q * rod[i, WEIGHT_Q], director_pull(c, pull))
    return dot_x, dot_q


@helper
def project_bend(s, rod, options, weights, change, work):
    """C^B = Im(p* r - sign rest) for neighbouring frames p and r, eq. (7)."""
    for i in range(len(s) - 2):
        p, r, bent = v4(s, i, Q), v4(s, i + 1, Q), v3(rod, i, DARBOUX + 1)
        relative = imaginary(p, r)
        along = dot3(relative, bent) + dot4(p, r) * rod[i, DARBOUX]
        value = mix(1.0, relative, 1.0 if along < 0 else -1.0, bent)
        value = mix(1.0, value, options.alpha_bend, v3(s, i, BEND))
        c = scale(-rod[i, INVERSE_BEND], value)
        put3(change, i, C_BEND, c)
        add3(s, i, BEND, 1.0, c)
        add4(work, i, TURN, weights.bend * rod[i, SHARE_Q], darboux_pull(c, r))
        add4(work, i + 1, TURN, -weights.bend * rod[i + 1, SHARE_Q], darboux_pull(c, p))


@helper
def project_bend_adjoint(g, rod, options, weights, before, change, work):
    dot_q = 0.0
    for i in range(len(g) - 2):
        p, r, c = v4(before, i, Q), v4(before, i + 1, Q), v3(change, i, C_BEND)
        pull_p, pull_r = v4(work, i, PULL_Q), v4(work, i + 1, PULL_Q)
        first, second = rod[i, SHARE_Q], rod[i + 1, SHARE_Q]
        by_turn = mix(first, imaginary(pull_p, r), second, imaginary(p, pull_r))
        dot_q += dot3(c, by_turn)
        g_change = mix(weights.bend, by_turn, 1.0, v3(g, i, BEND))
        g_value = scale(-rod[i, INVERSE_BEND], g_change)
        add3(g, i, BEND, options.alpha_bend, g_value)
        add4(g, i, Q, 1.0, darboux_pull(g_value, r))
        add4(g, i + 1, Q, -1.0, darboux_pull(g_value, p))
        add4(g, i, Q, weights.bend * second, darboux_pull(c, pull_r))
        add4(g, i + 1, Q, -weights.bend * first, darboux_pull(c, pull_p))
    return dot_q


@helper
def measure_edges(s, options, work):
    """Length and unit vector of every segment, eq. (9)."""
    for i in range(len(s) - 1):
        edge = mix(1.0, v3(s, i + 1, X), -1.0, v3(s, i, X))
        work[i, EDGE] = math.sqrt(dot3(edge, edge) + options.tiny)
        put3(work, i, DIRECTION, scale(1 / work[i, EDGE], edge))


@helper
def solve_jacobi(rod, b, column):
    """b / diagonal in place: every segment alone."""
    for i in range(len(b) - 1):
        b[i, column] /= rod[i, DIAGONAL]


@helper
def solve_thomas(rod, work, b, column):
    """A⁻¹ b in place; A has -w_i d_{i-1} · d_i beside its diagonal; A = L D L^T as LAPACK's dptsv.

    Where a pivot is not positive, A is not positive definite, and the result is NaN.
    """
    last = len(b) - 2
    work[0, PIVOT] = rod[0, DIAGONAL]
    for i in range(last):
        cosine = dot3(v3(work, i, DIRECTION), v3(work, i + 1, DIRECTION))
        off = -rod[i + 1, WEIGHT] * cosine
        work[i, RATIO] = off / work[i, PIVOT]
        pivot = rod[i + 1, DIAGONAL] - work[i, RATIO] * off
        work[i + 1, PIVOT] = pivot if pivot > 0 else math.nan
        b[i + 1, column] -= work[i, RATIO] * b[i, column]
    b[last, column] /= work[last, PIVOT]
    for i in range(last - 1, -1, -1):
        b[i, column] = b[i, column] / work[i, PIVOT] - work[i, RATIO] * b[i + 1, column]


@helper
def project_distance(s, rod, options, weights, change, work):
    """C^D = |e| - l, eq. (9), for every segment alone (Jacobi) or all together (Thomas)."""
    measure_edges(s, options, work)
    for i in range(len(s) - 1):
        value = work[i, EDGE] - rod[i, LENGTH]
        change[i, C_DISTANCE] = -(value + options.alpha_distance * s[i, DISTANCE])
    if options.thomas:
        solve_thomas(rod, work, change, C_DISTANCE)
    else:
        solve_jacobi(rod, change, C_DISTANCE)
    for i in range(len(s) - 1):
        direction, c = v3(work, i, DIRECTION), change[i, C_DISTANCE]
        s[i, DISTANCE] += c
        add3(work, i, MOVE, -weights.distance * rod[i, SHARE_D] * c, direction)
        add3(work, i + 1, MOVE, weights.distance * rod[i + 1, SHARE_D] * c, direction)


@helper
def project_distance_adjoint(g, rod, options, weights, before, change, work):
    """The system is symmetric: its adjoint is a = A⁻¹ g_change, the derivative by A is -a c^T."""
    dot_x = 0.0
    measure_edges(before, options, work)
    for i in range(len(g) - 1):
        first, second = rod[i, SHARE_D], rod[i + 1, SHARE_D]
        by_move = mix(second, v3(work, i + 1, PULL_X), -first, v3(work, i, PULL_X))
        along = dot3(v3(work, i, DIRECTION), by_move)
        dot_x += change[i, C_DISTANCE] * along
        work[i, G_CHANGE] = weights.distance * along + g[i, DISTANCE]
        put3(work, i, G_DIRECTION, scale(weights.distance * change[i, C_DISTANCE], by_move))
    if options.thomas:
        solve_thomas(rod, work, work, G_CHANGE)
        for i in range(len(g) - 2):
            cross = work[i + 1, G_CHANGE] * change[i, C_DISTANCE]
            cross += work[i, G_CHANGE] * change[i + 1, C_DISTANCE]
            cross *= rod[i + 1, WEIGHT]
            add3(work, i, G_DIRECTION, cross, v3(work, i + 1, DIRECTION))
            add3(work, i + 1, G_DIRECTION, cross, v3(work, i, DIRECTION))
    else:
        solve_jacobi(rod, work, G_CHANGE)
    for i in range(len(g) - 1):
        a, direction, turn = work[i, G_CHANGE], v3(work, i, DIRECTION), v3(work, i, G_DIRECTION)
        g[i, DISTANCE] -= options.alpha_distance * a
        turn = mix(1.0, turn, -dot3(direction, turn), direction)
        g_edge = mix(-a, direction, 1 / work[i, EDGE], turn)
        add3(g, i, X, -1.0, g_edge)
        add3(g, i + 1, X, 1.0, g_edge)
    return dot_x


# --- Iterations ----------------------------------------------------------------------------------


@helper
def begin_step(s, gravity, rod):
    """Free particles fall, gravity (K,) being η_x^G; the multipliers restart."""
    for i in range(len(s)):
        add3(s, i, X, gravity[i], v3(rod, i, FALL))
        for k in range(SHEAR, STATE_COLUMNS):
            s[i, k] = 0.0


@helper
def begin_step_adjoint(g, g_gravity, rod):
    for i in range(len(g)):
        g_gravity[i] += dot3(v3(g, i, X), v3(rod, i, FALL))
        for k in range(SHEAR, STATE_COLUMNS):
            g[i, k] = 0.0


@helper
def iterate(s, rod, options, weights, change, work):
    """One pass of the constraint loop (Algorithm 1, lines 4-9): all projections, then the moves."""
    for i in range(len(s)):
        for k in range(MOVE, EDGE):
            work[i, k] = 0.0
    project_shear(s, rod, options, weights, change, work)
    project_bend(s, rod, options, weights, change, work)
    project_distance(s, rod, options, weights, change, work)
    for i in range(len(s)):
        add3(s, i, X, 1.0, v3(work, i, MOVE))
    for i in range(len(s) - 1):
        add4(s, i, Q, 1.0, v4(work, i, TURN))
        q = v4(s, i, Q)
        change[i, Q_NORM] = math.sqrt(dot4(q, q) + 1e-300)
        for k in range(Q, SHEAR):
            s[i, k] /= change[i, Q_NORM]


@helper
def iterate_adjoint(g, rod, options, weights, before, after, change, work, dots):
    """g, the adjoint of the state after, becomes that of the state before."""
    for i in range(len(g)):
        put3(work, i, PULL_X, v3(g, i, X))
    for i in range(len(g) - 1):
        along = dot4(v4(after, i, Q), v4(g, i, Q))
        for k in range(4):
            g[i, Q + k] = (g[i, Q + k] - after[i, Q + k] * along) / change[i, Q_NORM]
            work[i, PULL_Q + k] = g[i, Q + k]
    shear_x, shear_q = project_shear_adjoint(g, rod, options, weights, before, change, work)
    dots[0] += project_distance_adjoint(g, rod, options, weights, before, change, work)
    dots[1] += shear_x
    dots[2] += shear_q
    dots[3] += project_bend_adjoint(g, rod, options, weights, before, change, work)


@helper
def rope_weights(eta):
    """From the (5,) of one rope: η_x^D, η_x^S, η_q^S, η_q^B, η^SOR."""
    half = 0.5 * eta[4]
    return Weights(half * eta[0], half * eta[1], half * eta[2], half * eta[3])


@helper
def finite(s):
    """Whether all of x and q is; not the row without a frame."""
    total = 0.0
    for i in range(len(s)):
        for k in range(SHEAR if i < len(s) - 1 else Q):
            total += 0.0 * s[i, k]
    return total == 0.0


@kernel
def run_ropes(state, gravity, eta, rod, options):
    """Algorithm 1 in place on state (B, K, STATE_COLUMNS); gravity (B, K), eta (B, 5)."""
    nodes = len(rod)
    change, work = np.empty((nodes, CHANGE_COLUMNS)), np.empty((nodes, WORK_COLUMNS))
    for rope in range(len(state)):
        s, weights = state[rope], rope_weights(eta[rope])
        for index in range(options.total):
            if index % options.iterations == 0:
                begin_step(s, gravity[rope], rod)
            iterate(s, rod, options, weights, change, work)
        if not finite(s):
            fill(s, math.nan)


@kernel
def pull_ropes(state, gravity, eta, rod, options, block, g_state, g_gravity, g_eta):
    """Adjoint of run_ropes: g_state, that of its result, becomes that of its start.

    Every rope runs again: once to keep its state at the start of each block of iterations, then,
    from the last block to the first, to record the block and walk it back.
    """
    nodes, blocks = len(rod), (options.total + block - 1) // block
    starts = np.empty((blocks, nodes, STATE_COLUMNS))
    path = np.empty((block + 1, nodes, STATE_COLUMNS))
    changes, work = np.empty((block, nodes, CHANGE_COLUMNS)), np.empty((nodes, WORK_COLUMNS))
    dots = np.empty(4)
    for rope in range(len(state)):
        s, g, weights = state[rope], g_state[rope], rope_weights(eta[rope])
        for k in range(4):
            dots[k] = 0.0
        copy(s, starts[0])
        for index in range((blocks - 1) * block):
            if index % options.iterations == 0:
                begin_step(s, gravity[rope], rod)
            iterate(s, rod, options, weights, changes[0], work)
            if (index + 1) % block == 0:
                copy(s, starts[(index + 1) // block])
        for number in range(blocks - 1, -1, -1):
            first, last = number * block, min((number + 1) * block, options.total)
            copy(starts[number], s)
            for index in range(first, last):
                if index % options.iterations == 0:
                    begin_step(s, gravity[rope], rod)
                copy(s, path[index - first])
                iterate(s, rod, options, weights, changes[index - first], work)
            copy(s, path[last - first])
            if last == options.total and not finite(s):
                fill(g, math.nan)
            for i in range(last - first - 1, -1, -1):
                iterate_adjoint(
                    g, rod, options, weights, path[i], path[i + 1], changes[i], work, dots
                )
                if (first + i) % options.iterations == 0:
                    begin_step_adjoint(g, g_gravity[rope], rod)
        half = 0.5 * eta[rope, 4]
        g_eta[rope, 4] = 0.0
        for k in range(4):
            g_eta[rope, k] = half * dots[k]
            g_eta[rope, 4] += 0.5 * eta[rope, k] * dots[k]
