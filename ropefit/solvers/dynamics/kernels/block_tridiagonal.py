"""The linear system of a step: block tridiagonal (6 x 6), solved by elimination."""

from __future__ import annotations

from ropefit.solvers.kernels.jit import helper


@helper
def _invert(a, order):
    """Replace a (6, 6) by its inverse, by Gauss-Jordan with row exchanges (order: scratch)."""
    for c in range(6):
        best, row = abs(a[c, c]), c
        for r in range(c + 1, 6):
            if abs(a[r, c]) > best:
                best, row = abs(a[r, c]), r
        order[c] = row
        if row != c:
            for k in range(6):
                a[c, k], a[row, k] = a[row, k], a[c, k]
        one = 1.0 / a[c, c]
        a[c, c] = 1.0
        for k in range(6):
            a[c, k] *= one
        for r in range(6):
            if r != c:
                f = a[r, c]
                a[r, c] = 0.0
                for k in range(6):
                    a[r, k] -= f * a[c, k]
    for c in range(5, -1, -1):
        row = order[c]
        if row != c:
            for k in range(6):
                a[k, c], a[k, row] = a[k, row], a[k, c]


@helper
def _given(out, k, row, f0, f1, f2):
    """Return a component of a matrix out[k] (3, 3) times a vector."""
    return out[k, row, 0] * f0 + out[k, row, 1] * f1 + out[k, row, 2] * f2


@helper
def factor(w, half):
    """Turn `pivot` into the inverses of the block pivots; half (6, 6) is scratch."""
    n = w.pivot.shape[0]
    for i in range(n):
        if i > 0:
            o, v, f = w.off[i - 1], w.pivot[i - 1], w.inverse_mass[i]
            # a -= Oᵀ V O with O = (off, W); W times dx/dz where a node touches
            for c in range(3):
                for r in range(6):
                    total = 0.0
                    for k in range(3):
                        total += v[r, k] * o[k, c]
                    half[r, c] = total
                    half[r, 3 + c] = v[r, 3 + c] * f
            touches = w.body[i] >= 0
            if touches:
                for c in range(3):
                    for r in range(6):
                        half[r, 3 + c] = f * _given(w.out, i, c, v[r, 3], v[r, 4], v[r, 5])
            a, even = w.pivot[i], 0.0 if touches else f
            for c in range(6):
                for r in range(3):
                    total = 0.0
                    for k in range(3):
                        total += o[k, r] * half[k, c]
                    a[r, c] -= total
                    a[3 + r, c] -= even * half[3 + r, c]
            if touches:
                for c in range(6):
                    for r in range(3):
                        a[3 + r, c] -= f * _given(w.out, i, r, half[3, c], half[4, c], half[5, c])
        _invert(w.pivot[i], w.order)


@helper
def solve_system(w, b, t):
    """Replace b (N, 6) by the solution; t (6,) is scratch."""
    n = b.shape[0]
    for i in range(1, n):
        o, v, f = w.off[i - 1], w.pivot[i - 1], w.inverse_mass[i]
        touches = w.body[i] >= 0
        for r in range(6):
            total = 0.0
            for k in range(6):
                total += v[r, k] * b[i - 1, k]
            t[r] = total
        for r in range(3):
            b[i, r] -= o[0, r] * t[0] + o[1, r] * t[1] + o[2, r] * t[2]
            b[i, 3 + r] -= f * (_given(w.out, i, r, t[3], t[4], t[5]) if touches else t[3 + r])
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            o, f, z = w.off[i], w.inverse_mass[i + 1], b[i + 1]
            touches = w.body[i + 1] >= 0
            for r in range(3):
                b[i, r] -= o[r, 0] * z[0] + o[r, 1] * z[1] + o[r, 2] * z[2]
                b[i, 3 + r] -= f * (
                    _given(w.out, i + 1, r, z[3], z[4], z[5]) if touches else z[3 + r]
                )
        for r in range(6):
            total = 0.0
            for k in range(6):
                total += w.pivot[i, r, k] * b[i, k]
            t[r] = total
        for r in range(6):
            b[i, r] = t[r]
