"""One iteration of Algorithm 1: the three constraints are projected, then the state moves.

Each `project_*` sets the change, adds it to the multiplier, and its weighted move to the scratch.
"""

from __future__ import annotations

import math

from ropefit.solvers.kernels.jit import exact_helper
from ropefit.solvers.xpbd.kernels.forms import (
    darboux_pull,
    director_product,
    director_pull,
    imaginary,
)
from ropefit.solvers.xpbd.kernels.tables import (
    BEND,
    C_BEND,
    C_DISTANCE,
    C_SHEAR,
    DARBOUX,
    DIAGONAL,
    DIRECTION,
    DISTANCE,
    EDGE,
    FALL,
    INVERSE_BEND,
    INVERSE_SHEAR,
    LENGTH,
    MOVE,
    PIVOT,
    Q_NORM,
    RATIO,
    SHARE,
    SHARE_D,
    SHARE_Q,
    SHEAR,
    STATE_COLUMNS,
    TURN,
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
def project_shear(s, rod, options, weights, change, work):
    """Project C^S = e / l - G(q) q / 2, eq. (5)."""
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


@exact_helper
def project_bend(s, rod, options, weights, change, work):
    """Project C^B = Im(p* r - sign rest) for neighbouring frames p and r, eq. (7)."""
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


@exact_helper
def measure_edges(s, options, work):
    """Measure length and unit vector of every segment, eq. (9)."""
    for i in range(len(s) - 1):
        edge = mix(1.0, v3(s, i + 1, X), -1.0, v3(s, i, X))
        work[i, EDGE] = math.sqrt(dot3(edge, edge) + options.tiny)
        put3(work, i, DIRECTION, scale(1 / work[i, EDGE], edge))


@exact_helper
def solve_jacobi(rod, b, column):
    """Solve b / diagonal in place: every segment alone."""
    for i in range(len(b) - 1):
        b[i, column] /= rod[i, DIAGONAL]


@exact_helper
def solve_thomas(rod, work, b, column):
    """Solve A⁻¹ b in place; A has -w_i d_{i-1} · d_i beside its diagonal; A = L D L^T as LAPACK's
    dptsv.

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


@exact_helper
def solve_distance(rod, options, work, b, column):
    """Solve the system of the distance constraint in place, which is symmetric."""
    if options.thomas:
        solve_thomas(rod, work, b, column)
    else:
        solve_jacobi(rod, b, column)


@exact_helper
def project_distance(s, rod, options, weights, change, work):
    """Project C^D = |e| - l, eq. (9), for every segment alone (Jacobi) or all together (Thomas)."""
    measure_edges(s, options, work)
    for i in range(len(s) - 1):
        value = work[i, EDGE] - rod[i, LENGTH]
        change[i, C_DISTANCE] = -(value + options.alpha_distance * s[i, DISTANCE])
    solve_distance(rod, options, work, change, C_DISTANCE)
    for i in range(len(s) - 1):
        direction, c = v3(work, i, DIRECTION), change[i, C_DISTANCE]
        s[i, DISTANCE] += c
        add3(work, i, MOVE, -weights.distance * rod[i, SHARE_D] * c, direction)
        add3(work, i + 1, MOVE, weights.distance * rod[i + 1, SHARE_D] * c, direction)


@exact_helper
def begin_step(s, gravity, rod):
    """Free particles fall, gravity (K,) being η_x^G; the multipliers restart."""
    for i in range(len(s)):
        add3(s, i, X, gravity[i], v3(rod, i, FALL))
        for k in range(SHEAR, STATE_COLUMNS):
            s[i, k] = 0.0


@exact_helper
def iterate(s, rod, options, weights, change, work):
    """Run one pass of the constraint loop (Algorithm 1, lines 4-9): all projections, then the
    moves."""
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
