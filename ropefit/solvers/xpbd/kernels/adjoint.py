"""The reverse-mode derivative of one iteration.

Each `*_adjoint` adds to g, the adjoint of the state before, and returns (move without its weight) ·
pull, which is the derivative by the weight; pull is the adjoint of the state after.
"""

from __future__ import annotations

from ropefit.solvers.kernels.jit import exact_helper
from ropefit.solvers.xpbd.kernels.forms import (
    darboux_pull,
    director_product,
    director_pull,
    imaginary,
)
from ropefit.solvers.xpbd.kernels.iterations import measure_edges, solve_distance
from ropefit.solvers.xpbd.kernels.tables import (
    BEND,
    C_BEND,
    C_DISTANCE,
    C_SHEAR,
    DIRECTION,
    DISTANCE,
    EDGE,
    FALL,
    G_CHANGE,
    G_DIRECTION,
    INVERSE_BEND,
    INVERSE_SHEAR,
    LENGTH,
    PULL_Q,
    PULL_X,
    Q_NORM,
    SHARE,
    SHARE_D,
    SHARE_Q,
    SHEAR,
    STATE_COLUMNS,
    WEIGHT,
    WEIGHT_Q,
    Q,
    X,
    add3,
    add4,
    dot3,
    dot4,
    mix,
    put3,
    scale,
    v3,
    v4,
)


@exact_helper
def project_shear_adjoint(g, rod, options, weights, before, change, work):
    """Apply the adjoint of the stretch-shear projection, eq. (5)."""
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


@exact_helper
def project_bend_adjoint(g, rod, options, weights, before, change, work):
    """Apply the adjoint of the bend-twist projection, eq. (7)."""
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


@exact_helper
def project_distance_adjoint(g, rod, options, weights, before, change, work):
    """Apply the adjoint: the system is symmetric, a = A⁻¹ g_change, the derivative by A is -a
    c^T."""
    dot_x = 0.0
    measure_edges(before, options, work)
    for i in range(len(g) - 1):
        first, second = rod[i, SHARE_D], rod[i + 1, SHARE_D]
        by_move = mix(second, v3(work, i + 1, PULL_X), -first, v3(work, i, PULL_X))
        along = dot3(v3(work, i, DIRECTION), by_move)
        dot_x += change[i, C_DISTANCE] * along
        work[i, G_CHANGE] = weights.distance * along + g[i, DISTANCE]
        put3(work, i, G_DIRECTION, scale(weights.distance * change[i, C_DISTANCE], by_move))
    solve_distance(rod, options, work, work, G_CHANGE)
    if options.thomas:
        for i in range(len(g) - 2):
            cross = work[i + 1, G_CHANGE] * change[i, C_DISTANCE]
            cross += work[i, G_CHANGE] * change[i + 1, C_DISTANCE]
            cross *= rod[i + 1, WEIGHT]
            add3(work, i, G_DIRECTION, cross, v3(work, i + 1, DIRECTION))
            add3(work, i + 1, G_DIRECTION, cross, v3(work, i, DIRECTION))
    for i in range(len(g) - 1):
        a, direction, turn = work[i, G_CHANGE], v3(work, i, DIRECTION), v3(work, i, G_DIRECTION)
        g[i, DISTANCE] -= options.alpha_distance * a
        turn = mix(1.0, turn, -dot3(direction, turn), direction)
        g_edge = mix(-a, direction, 1 / work[i, EDGE], turn)
        add3(g, i, X, -1.0, g_edge)
        add3(g, i + 1, X, 1.0, g_edge)
    return dot_x


@exact_helper
def begin_step_adjoint(g, g_gravity, rod):
    """Apply the adjoint of the fall that begins a step; multipliers of the step before end here."""
    for i in range(len(g)):
        g_gravity[i] += dot3(v3(g, i, X), v3(rod, i, FALL))
        for k in range(SHEAR, STATE_COLUMNS):
            g[i, k] = 0.0


@exact_helper
def iterate_adjoint(g, rod, options, weights, before, after, change, work, dots):
    """Turn g, the adjoint of the state after, into that of the state before."""
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
