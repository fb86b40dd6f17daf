"""The linear system: block tridiagonal (3 x 3), bordered by a column for each support."""

from __future__ import annotations

import math

from ropefit.solvers.equilibrium.kernels.small_matrices import negative_eigenvalues
from ropefit.solvers.kernels.jit import helper, inlined


@helper
def factor(w, shift, mass, length):
    """Invert the pivots of A + shift + mass diag(l); returns how many of their signs are
    negative."""
    negative = 0
    for i in range(w.diagonal.shape[0]):
        add = shift + mass * length[i]
        m = w.inverse[i]  # the pivot first, then its inverse
        for a in range(3):
            for c in range(3):
                m[a, c] = w.diagonal[i, a, c]
            m[a, a] += add
        if i > 0:
            _eliminate(w.off[i - 1], w.inverse[i - 1], m)
        negative += _invert(m)
    return negative


@inlined
def _eliminate(o, v, m):
    """Subtract oᵀ v o from m, all (3, 3)."""
    # t = v o
    t00 = v[0, 0] * o[0, 0] + v[0, 1] * o[1, 0] + v[0, 2] * o[2, 0]
    t01 = v[0, 0] * o[0, 1] + v[0, 1] * o[1, 1] + v[0, 2] * o[2, 1]
    t02 = v[0, 0] * o[0, 2] + v[0, 1] * o[1, 2] + v[0, 2] * o[2, 2]
    t10 = v[1, 0] * o[0, 0] + v[1, 1] * o[1, 0] + v[1, 2] * o[2, 0]
    t11 = v[1, 0] * o[0, 1] + v[1, 1] * o[1, 1] + v[1, 2] * o[2, 1]
    t12 = v[1, 0] * o[0, 2] + v[1, 1] * o[1, 2] + v[1, 2] * o[2, 2]
    t20 = v[2, 0] * o[0, 0] + v[2, 1] * o[1, 0] + v[2, 2] * o[2, 0]
    t21 = v[2, 0] * o[0, 1] + v[2, 1] * o[1, 1] + v[2, 2] * o[2, 1]
    t22 = v[2, 0] * o[0, 2] + v[2, 1] * o[1, 2] + v[2, 2] * o[2, 2]
    m[0, 0] -= o[0, 0] * t00 + o[1, 0] * t10 + o[2, 0] * t20
    m[0, 1] -= o[0, 0] * t01 + o[1, 0] * t11 + o[2, 0] * t21
    m[0, 2] -= o[0, 0] * t02 + o[1, 0] * t12 + o[2, 0] * t22
    m[1, 0] -= o[0, 1] * t00 + o[1, 1] * t10 + o[2, 1] * t20
    m[1, 1] -= o[0, 1] * t01 + o[1, 1] * t11 + o[2, 1] * t21
    m[1, 2] -= o[0, 1] * t02 + o[1, 1] * t12 + o[2, 1] * t22
    m[2, 0] -= o[0, 2] * t00 + o[1, 2] * t10 + o[2, 2] * t20
    m[2, 1] -= o[0, 2] * t01 + o[1, 2] * t11 + o[2, 2] * t21
    m[2, 2] -= o[0, 2] * t02 + o[1, 2] * t12 + o[2, 2] * t22


@inlined
def _invert(m):
    """Replace m (3, 3) by its inverse; returns how many negative signs its leading minors have."""
    m00, m01, m02 = m[0, 0], m[0, 1], m[0, 2]
    m10, m11, m12 = m[1, 0], m[1, 1], m[1, 2]
    m20, m21, m22 = m[2, 0], m[2, 1], m[2, 2]
    nudge = 1e-14 * (abs(m00) + abs(m11) + abs(m22)) + 1e-200
    while True:
        c00, c01, c02 = m11 * m22 - m12 * m21, m02 * m21 - m01 * m22, m01 * m12 - m02 * m11
        c10, c11, c12 = m12 * m20 - m10 * m22, m00 * m22 - m02 * m20, m02 * m10 - m00 * m12
        c20, c21, c22 = m10 * m21 - m11 * m20, m01 * m20 - m00 * m21, m00 * m11 - m01 * m10
        det = m00 * c00 + m01 * c10 + m02 * c20
        if not abs(det) < 1e-250:
            break
        # Exactly singular, as straight struts can be: the same matrix but for rounding.
        m00, m11, m22 = m00 + nudge, m11 + nudge, m22 + nudge
        nudge *= 16
    negative = 0
    minor = c22
    if m00 < 0:
        negative += 1
    if (minor < 0) != (m00 < 0):
        negative += 1
    if (det < 0) != (minor < 0):
        negative += 1
    f = 1.0 / det
    m[0, 0], m[0, 1], m[0, 2] = c00 * f, c01 * f, c02 * f
    m[1, 0], m[1, 1], m[1, 2] = c10 * f, c11 * f, c12 * f
    m[2, 0], m[2, 1], m[2, 2] = c20 * f, c21 * f, c22 * f
    return negative


@helper
def solve_columns(w, columns, transposed):
    """Write A⁻¹ border[..., :columns] (or A⁻ᵀ) into solved, with the factors in `inverse`."""
    n = w.diagonal.shape[0]
    z, b = w.solved, w.border
    for i in range(n):
        v00, v01, v02, v10, v11, v12, v20, v21, v22 = _entries(w.inverse[i], transposed)
        before = max(i - 1, 0)
        o00, o01, o02, o10, o11, o12, o20, o21, o22 = _entries(w.off[before], True)
        for c in range(columns):
            r0, r1, r2 = b[i, 0, c], b[i, 1, c], b[i, 2, c]
            if i > 0:
                y0, y1, y2 = z[before, 0, c], z[before, 1, c], z[before, 2, c]
                r0 -= o00 * y0 + o01 * y1 + o02 * y2
                r1 -= o10 * y0 + o11 * y1 + o12 * y2
                r2 -= o20 * y0 + o21 * y1 + o22 * y2
            z[i, 0, c] = v00 * r0 + v01 * r1 + v02 * r2
            z[i, 1, c] = v10 * r0 + v11 * r1 + v12 * r2
            z[i, 2, c] = v20 * r0 + v21 * r1 + v22 * r2
    for i in range(n - 2, -1, -1):
        v00, v01, v02, v10, v11, v12, v20, v21, v22 = _entries(w.inverse[i], transposed)
        o00, o01, o02, o10, o11, o12, o20, o21, o22 = _entries(w.off[i], False)
        for c in range(columns):
            y0, y1, y2 = z[i + 1, 0, c], z[i + 1, 1, c], z[i + 1, 2, c]
            r0 = o00 * y0 + o01 * y1 + o02 * y2
            r1 = o10 * y0 + o11 * y1 + o12 * y2
            r2 = o20 * y0 + o21 * y1 + o22 * y2
            z[i, 0, c] -= v00 * r0 + v01 * r1 + v02 * r2
            z[i, 1, c] -= v10 * r0 + v11 * r1 + v12 * r2
            z[i, 2, c] -= v20 * r0 + v21 * r1 + v22 * r2


@inlined
def _entries(m, transposed):
    """Return the entries of m (3, 3), or of its transpose, row by row, as scalars: in a loop over
    columns they stay in registers."""
    if transposed:
        return (m[0, 0], m[1, 0], m[2, 0], m[0, 1], m[1, 1], m[2, 1], m[0, 2], m[1, 2], m[2, 2])
    return (m[0, 0], m[0, 1], m[0, 2], m[1, 0], m[1, 1], m[1, 2], m[2, 0], m[2, 1], m[2, 2])


@helper
def set_schur(w, count):
    """Write corner - borderᵀ A⁻¹ border into `schur` for the first `count` columns, already
    solved."""
    out, size = w.schur, count + 3
    for s in range(size):
        for t in range(size):
            out[s, t] = 0.0
    for i in range(w.diagonal.shape[0]):
        z = w.solved[i]
        for s in range(count):
            b0, b1, b2 = w.border[i, 0, s], w.border[i, 1, s], w.border[i, 2, s]
            if b0 == 0.0 and b1 == 0.0 and b2 == 0.0:  # beyond the node that is supported
                continue
            for t in range(count):  # along memory: many at once
                out[s, t] += b0 * z[0, t] + b1 * z[1, t] + b2 * z[2, t]
    for s in range(size):
        for t in range(size):
            out[s, t] = w.corner[s, t] - out[s, t]


@helper
def _unstable_directions(w, held, negative):
    """Return how many directions allowed by the supports lower the energy.

    A saddle's Hessian has as many negative signs as supports that bear on the rope (c >= 0); each
    more is a direction of descent.
    """
    count = held.node.shape[0]
    expected = 0
    plain = negative == 0 and not held.free
    for s in range(count):
        if held.active[s] and held.compliance[s] >= 0:
            expected += 1
        elif held.active[s]:
            plain = False
    if plain:
        return 0
    size = count + 3 if held.free else count
    if size == 0:
        return negative
    for s in range(size):
        for t in range(size):
            if not math.isfinite(w.schur[s, t]):
                return 1
    found = negative + negative_eigenvalues(w.schur, size, w.small)
    for s in range(count):
        if not held.active[s]:
            found -= 1
    return found - expected


@helper
def factor_system(rod, held, w, shift, mass):
    """Factor, solve all support columns and the residual's; return the descent directions."""
    count = held.node.shape[0]
    negative = factor(w, shift, mass, rod.length)
    solve_columns(w, count + 1, False)
    set_schur(w, count)
    return _unstable_directions(w, held, negative)
