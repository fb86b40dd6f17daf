"""Products with many right sides at once: directions of change are the last axis of every array.

The innermost loops run along that axis, where the compiler makes vector instructions of them; a
loop over directions outside would do the same arithmetic number by number, at three times the cost.
Such loops are slow to compile: most products therefore are one function's.
"""

from __future__ import annotations

from ropefit.rod.fields import PLANE
from ropefit.solvers.dynamics.kernels.contact import PUSHED, gap_of
from ropefit.solvers.kernels.jit import helper, not_inlined


@not_inlined
def add_product(m, sign, d, out, at):
    """Add m (3, 3), times a sign, times the first rows of d (3.., P) to three rows of out."""
    for r in range(3):
        m0, m1, m2 = sign * m[r, 0], sign * m[r, 1], sign * m[r, 2]
        for s in range(out.shape[1]):
            out[at + r, s] += m0 * d[0, s] + m1 * d[1, s] + m2 * d[2, s]


@helper
def set_turning(h, x, y, z, m):
    """Write h + [v]x of v = (x, y, z) into m (3, 3)."""
    m[0, 0], m[0, 1], m[0, 2] = h, -z, y
    m[1, 0], m[1, 1], m[1, 2] = z, h, -x
    m[2, 0], m[2, 1], m[2, 2] = -y, x, h


@helper
def transpose(m):
    """Transpose m (3, 3) in place."""
    for r in range(3):
        for c in range(r):
            m[r, c], m[c, r] = m[c, r], m[r, c]


@not_inlined
def copy_all(source, target):
    """Copy an array of three dimensions."""
    for k in range(source.shape[0]):
        for a in range(source.shape[1]):
            for s in range(source.shape[2]):
                target[k, a, s] = source[k, a, s]


@not_inlined
def set_pasts(rate, one, two, out):
    """Write c1 one + c2 two into out (K, 3, P), with coefficients of D for each row (K.., 3)."""
    for k in range(out.shape[0]):
        c1, c2 = rate[k, 1], rate[k, 2]
        for a in range(3):
            for s in range(out.shape[2]):
                out[k, a, s] = c1 * one[k, a, s] + c2 * two[k, a, s]


@not_inlined
def _pivot_times(v, b, t):
    """Write v (6, 6) times b (6, P) into t."""
    for r in range(6):
        v0, v1, v2, v3, v4, v5 = v[r, 0], v[r, 1], v[r, 2], v[r, 3], v[r, 4], v[r, 5]
        for s in range(t.shape[1]):
            t[r, s] = (
                v0 * b[0, s] + v1 * b[1, s] + v2 * b[2, s]
                + v3 * b[3, s] + v4 * b[4, s] + v5 * b[5, s]
            )  # fmt: skip


@helper
def set_yielding(w, i, m):
    """Write how node i moves by a force on it into m (3, 3)."""
    f = w.inverse_mass[i]
    for r in range(3):
        for c in range(3):
            m[r, c] = f * (w.out[i, r, c] if w.body[i] >= 0 else r == c)


@helper
def _take_off(w, i, force, m, out):
    """Subtract from the last rows of out (6, P) what node i moves by those of force (6, P)."""
    set_yielding(w, i, m)
    add_product(m, -1.0, force[3:], out, 3)


@helper
def solve_systems(w, b, t, m):
    """Replace b (N, 6, P) by the solutions; t (6, P) and m (3, 3) are scratch. Compare
    `solve_system`."""
    n = b.shape[0]
    for i in range(1, n):
        _pivot_times(w.pivot[i - 1], b[i - 1], t)
        for r in range(3):
            for c in range(3):
                m[r, c] = w.off[i - 1, c, r]
        add_product(m, -1.0, t, b[i], 0)
        _take_off(w, i, t, m, b[i])
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            add_product(w.off[i], -1.0, b[i + 1], b[i], 0)
            _take_off(w, i + 1, b[i + 1], m, b[i])
        _pivot_times(w.pivot[i], b[i], t)
        for r in range(6):
            for s in range(b.shape[2]):
                b[i, r, s] = t[r, s]


@helper
def meet_bodies(rod, change, w, dy):
    """Turn moves dy (N+1, 3, P) of the nodes without bodies into moves with them; change (B, 8, P)
    of the bodies."""
    for k in range(dy.shape[0]):
        if w.body[k] < 0:
            continue
        body, d, z, out = rod.bodies[w.body[k]], change[w.body[k]], w.z[k], w.out[k]
        gap, n0, n1, n2, far = gap_of(body, z[0], z[1], z[2])
        n = (n0, n1, n2)
        for s in range(dy.shape[2]):
            y = (dy[k, 0, s], dy[k, 1, s], dy[k, 2, s])
            along, at, turned, moved = 0.0, 0.0, 0.0, 0.0
            for a in range(3):
                arm = z[a] - body[a]
                along += body[3 + a] * arm
                at += body[3 + a] * d[a, s]
                turned += d[3 + a, s] * arm
                moved -= n[a] * d[a, s]
            if body[7] == PLANE:
                for a in range(3):
                    dy[k, a, s] = -PUSHED * ((moved + turned) * n[a] + gap * d[3 + a, s])
            else:
                for a in range(3):
                    moved -= n[a] * along * d[3 + a, s]  # n is across the axis
                for a in range(3):
                    across = -d[a, s] + body[3 + a] * (at - turned) - along * d[3 + a, s]
                    way = (moved - d[6, s]) * n[a] + gap / far * (across - moved * n[a])
                    dy[k, a, s] = -PUSHED * way
            for a in range(3):
                dy[k, a, s] += out[a, 0] * y[0] + out[a, 1] * y[1] + out[a, 2] * y[2]
