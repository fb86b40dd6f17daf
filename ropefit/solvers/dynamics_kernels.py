"""One rope after the other through time, compiled; see `dynamics.py`.

Every step is a small equilibrium: the strains, moments and turns of `newton_kernels.py`, with the
nodes' inertia and the dampings as terms of an incremental potential. A rate is the second-order
backward difference D[y] = c0 y + c1 y' + c2 y'' of the new value and the two before it (BDF2 for
any steps; the first step has one before it and is backward Euler), so with v = D[x], a = D[v]

    m a + air v = load + n_k - n_{k-1}     at each free node, n_i the force in segment i
    x_{i+1} - x_i = R_i l (e3 + Γ),        Γ + supple viscous D[Γ] = supple Rᵀn
    0 = moments of n and of the bends      about the directors of each segment,
                                           with m_j = stiff (p - rest) + loss D[p] in each bend

where p is the Darboux vector. A node's x follows from the forces beside it, so unknown are the turn
and the force of each segment: a symmetric block tridiagonal system (6 x 6), linear cost in N. A
rope that does not stretch (supple = 0) is no harder than any other. Segments have no spin inertia.

numba's cache notices changes of this file only; `_entries` adds those of `newton_kernels.py`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from ropefit.solvers import newton_kernels
from ropefit.solvers.newton_kernels import (
    _add_square,
    _cross_block,
    _darboux,
    _rotation,
    _turn,
    helper,
    kernel,
)

CONVERGED, LIMIT, NOT_FINITE = range(3)
TURN_LIMIT = 0.5  # rad: largest turn of a segment in one iteration
PATIENCE = 12  # iterations of full length, then as many of half, ...
REACH = 1e-6  # rad, and relative in force: a step below it leaves an error of its square


class Rod(NamedTuple):
    """One rope, or R with one more dimension in front: length (N,) [m], supple (N, 3) [1/N],
    viscous (N, 3) [N s], stiff (N+1, 3) [N m], loss (N+1, 3) [N m s], rest (N+1, 4), load (N+1, 3)
    [N], mass (N+1,) [kg], air (N+1,) [N s/m], gauge () [N m] (see `newton_kernels._assemble`)."""

    length: np.ndarray
    supple: np.ndarray
    viscous: np.ndarray
    stiff: np.ndarray
    loss: np.ndarray
    rest: np.ndarray
    load: np.ndarray
    mass: np.ndarray
    air: np.ndarray
    gauge: np.ndarray


class Drive(NamedTuple):
    """What moves one clip of T times, or C clips: time (T,) [s], ends (T, 2, 3) [m], clamp
    (T, 2, 4); held (2,) whether each end's position is given."""

    time: np.ndarray
    ends: np.ndarray
    clamp: np.ndarray
    held: np.ndarray


class Change(NamedTuple):
    """Changes of a `Rod` and of what moves it: shapes as there, rest (N+1, 3), clamp (T, 2, 3) as
    turns [rad] about its own axes; x0, v0 (N+1, 3), q0 (N, 3) as turns."""

    length: np.ndarray
    supple: np.ndarray
    viscous: np.ndarray
    stiff: np.ndarray
    loss: np.ndarray
    rest: np.ndarray
    load: np.ndarray
    mass: np.ndarray
    air: np.ndarray
    ends: np.ndarray
    clamp: np.ndarray
    x0: np.ndarray
    v0: np.ndarray
    q0: np.ndarray


class Work(NamedTuple):
    """Scratch of one step."""

    frame: np.ndarray  # R (N, 3, 3)
    u: np.ndarray  # force in the segment's own frame
    g: np.ndarray  # edge in it
    yields: np.ndarray  # l dΓ/du
    x: np.ndarray
    y: np.ndarray  # nodes without the forces in the segments
    inverse_mass: np.ndarray  # W (N+1,): x = y + W (n_k - n_{k-1})
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


@helper
def make_work(n):
    return Work(
        np.zeros((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros(n + 1), np.zeros((n + 1, 4)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n, 6, 6)), np.zeros((n, 3, 3)),
        np.zeros((n, 6)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)),
        np.zeros((n, 3)),
    )  # fmt: skip


@helper
def _rates(time, t):
    """c0, c1, c2 of D at time t."""
    h = time[t] - time[t - 1]
    if t == 1:
        return 1.0 / h, -1.0 / h, 0.0
    w = h / (time[t - 1] - time[t - 2])
    return (1 + 2 * w) / ((1 + w) * h), -(1 + w) / h, w * w / ((1 + w) * h)


@helper
def _jointed(stiff, loss, j):
    """Whether there is a bend at node j: not at the ends of a rope that is not clamped."""
    return (
        stiff[j, 0] != 0.0
        or stiff[j, 1] != 0.0
        or stiff[j, 2] != 0.0
        or loss[j, 0] != 0.0
        or loss[j, 1] != 0.0
        or loss[j, 2] != 0.0
    )


@helper
def _bend(rod, clamp, q, p):
    """Darboux quaternions p (N+1, 4) of a state."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if _jointed(rod.stiff, rod.loss, j):
            before = clamp[0] if j == 0 else q[j - 1]
            after = clamp[1] if j == n else q[j]
            _darboux(before, after, rod.rest[j], p[j])


@helper
def _strain(rod, x, q, r, out):
    """Γ (N, 3) of a state; r (3, 3) is scratch."""
    for i in range(rod.length.shape[0]):
        _rotation(q[i], r)
        for a in range(3):
            out[i, a] = 0.0
            for b in range(3):
                out[i, a] += r[b, a] * (x[i + 1, b] - x[i, b]) / rod.length[i]
        out[i, 2] -= 1.0


@helper
def _speeds(time, xs, v0, v):
    """v (T, N+1, 3) of the nodes xs (T, N+1, 3)."""
    v[0] = v0
    for t in range(1, time.shape[0]):
        c0, c1, c2 = _rates(time, t)
        for k in range(xs.shape[1]):
            for a in range(3):
                v[t, k, a] = c0 * xs[t, k, a] + c1 * xs[t - 1, k, a]
                if t > 1:
                    v[t, k, a] += c2 * xs[t - 2, k, a]


@helper
def _past(c1, c2, one, two, out):
    """out = c1 one + c2 two, row by row."""
    for k in range(out.shape[0]):
        for a in range(3):
            out[k, a] = c1 * one[k, a] + c2 * two[k, a]


@helper
def _prepare(rod, drive, t, c0, w):
    """What stays the same in the iterations of a step."""
    n = rod.length.shape[0]
    for k in range(n + 1):
        end = 0 if k == 0 else 1
        if (k == 0 or k == n) and drive.held[end]:
            w.inverse_mass[k] = 0.0
            for a in range(3):
                w.y[k, a] = drive.ends[t, end, a]
            continue
        drag = rod.mass[k] * c0 + rod.air[k]
        w.inverse_mass[k] = 1.0 / (drag * c0)
        for a in range(3):
            known = rod.load[k, a] - drag * w.old_x[k, a] - rod.mass[k] * w.old_v[k, a]
            w.y[k, a] = w.inverse_mass[k] * known
    for j in range(n + 1):
        for a in range(3):
            w.firm[j, a] = rod.stiff[j, a] + c0 * rod.loss[j, a]


@helper
def _assemble(rod, drive, t, c0, q, force, w):
    """Residual into `right`, matrix into `pivot` (diagonal blocks) and `off`, at a state."""
    n = rod.length.shape[0]
    for k in range(n + 1):
        for a in range(3):
            pull = 0.0
            if k < n:
                pull += force[k, a]
            if k > 0:
                pull -= force[k - 1, a]
            w.x[k, a] = w.y[k, a] + w.inverse_mass[k] * pull
    for i in range(n):
        r, l = w.frame[i], rod.length[i]
        _rotation(q[i], r)
        for a in range(3):
            w.u[i, a] = r[0, a] * force[i, 0] + r[1, a] * force[i, 1] + r[2, a] * force[i, 2]
            share = rod.supple[i, a] / (1 + rod.supple[i, a] * rod.viscous[i, a] * c0)
            w.yields[i, a] = l * share
            w.g[i, a] = l * share * (w.u[i, a] - rod.viscous[i, a] * w.old_strain[i, a])
        w.g[i, 2] += l
        g, u, e = w.g[i], w.u[i], w.yields[i]
        b = w.right[i]
        b[0] = -(g[1] * u[2] - g[2] * u[1])
        b[1] = -(g[2] * u[0] - g[0] * u[2])
        b[2] = -(g[0] * u[1] - g[1] * u[0])
        h = w.pivot[i]
        h[:] = 0.0
        gu = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
        h[0, 0] = gu - g[0] * u[0] - (u[2] * u[2] * e[1] + u[1] * u[1] * e[2])
        h[1, 1] = gu - g[1] * u[1] - (u[2] * u[2] * e[0] + u[0] * u[0] * e[2])
        h[2, 2] = gu - g[2] * u[2] - (u[1] * u[1] * e[0] + u[0] * u[0] * e[1])
        h[0, 1] = -0.5 * (g[0] * u[1] + g[1] * u[0]) + u[0] * u[1] * e[2]
        h[0, 2] = -0.5 * (g[0] * u[2] + g[2] * u[0]) + u[0] * u[2] * e[1]
        h[1, 2] = -0.5 * (g[1] * u[2] + g[2] * u[1]) + u[1] * u[2] * e[0]
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        for d in range(3):
            edge = 0.0
            for a in range(3):
                edge += r[d, a] * g[a]
            b[3 + d] = w.x[i + 1, d] - w.x[i, d] - edge
            v0, v1, v2 = r[d, 0], r[d, 1], r[d, 2]
            e0, e1, e2 = e[0] * v0, e[1] * v1, e[2] * v2
            h[0, 3 + d] = -(e1 * u[2] - e2 * u[1] + g[1] * v2 - g[2] * v1)
            h[1, 3 + d] = -(e2 * u[0] - e0 * u[2] + g[2] * v0 - g[0] * v2)
            h[2, 3 + d] = -(e0 * u[1] - e1 * u[0] + g[0] * v1 - g[1] * v0)
            for a in range(3):
                h[3 + d, a] = h[a, 3 + d]
                h[3 + d, 3 + a] = -(e0 * r[a, 0] + e1 * r[a, 1] + e2 * r[a, 2])
            h[3 + d, 3 + d] -= w.inverse_mass[i] + w.inverse_mass[i + 1]
        w.off[i] = 0.0
    _bend(rod, drive.clamp[t], q, w.p)
    for j in range(n + 1):
        if not _jointed(rod.stiff, rod.loss, j):
            continue
        p, m, k = w.p[j], w.m[j], w.firm[j]
        for a in range(3):
            rate = c0 * p[a + 1] + w.old_p[j, a]
            m[a] = rod.stiff[j, a] * (p[a + 1] - rod.rest[j, a + 1]) + rod.loss[j, a] * rate
        c_0 = 0.5 * (p[2] * m[2] - p[3] * m[1])
        c_1 = 0.5 * (p[3] * m[0] - p[1] * m[2])
        c_2 = 0.5 * (p[1] * m[1] - p[2] * m[0])
        h = 0.5 * p[0]
        bend = 0.25 * (m[0] * p[1] + m[1] * p[2] + m[2] * p[3])
        x, y, z = 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
        if j < n:
            b = w.right[j]
            b[0] += h * m[0] - c_0
            b[1] += h * m[1] - c_1
            b[2] += h * m[2] - c_2
            _add_square(w.pivot[j], k, h, x, y, z, bend)
        if j > 0:
            b = w.right[j - 1]
            b[0] += -h * m[0] - c_0
            b[1] += -h * m[1] - c_1
            b[2] += -h * m[2] - c_2
            _add_square(w.pivot[j - 1], k, -h, x, y, z, bend)
        if 0 < j < n:
            _cross_block(p, m, k, w.off[j - 1])
    w.pivot[0, 2, 2] += rod.gauge


@helper
def _invert(a):
    """a (6, 6) becomes its inverse, by Gauss-Jordan with row exchanges."""
    order = np.empty(6, np.int64)
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
def _factor(w, half):
    """Turn `pivot` into the inverses of the block pivots; half (6, 6) is scratch."""
    n = w.pivot.shape[0]
    for i in range(n):
        if i > 0:
            o, v, f = w.off[i - 1], w.pivot[i - 1], w.inverse_mass[i]
            # a -= Oᵀ V O with O = (off, W)
            for c in range(3):
                for r in range(6):
                    total = 0.0
                    for k in range(3):
                        total += v[r, k] * o[k, c]
                    half[r, c] = total
                    half[r, 3 + c] = v[r, 3 + c] * f
            a = w.pivot[i]
            for c in range(6):
                for r in range(3):
                    total = 0.0
                    for k in range(3):
                        total += o[k, r] * half[k, c]
                    a[r, c] -= total
                    a[3 + r, c] -= f * half[3 + r, c]
        _invert(w.pivot[i])


@helper
def _solve(w, b, t):
    """b (N, 6) becomes the solution; t (6,) is scratch."""
    n = b.shape[0]
    for i in range(1, n):
        o, v, f = w.off[i - 1], w.pivot[i - 1], w.inverse_mass[i]
        for r in range(6):
            total = 0.0
            for k in range(6):
                total += v[r, k] * b[i - 1, k]
            t[r] = total
        for r in range(3):
            b[i, r] -= o[0, r] * t[0] + o[1, r] * t[1] + o[2, r] * t[2]
            b[i, 3 + r] -= f * t[3 + r]
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            o, f, z = w.off[i], w.inverse_mass[i + 1], b[i + 1]
            for r in range(3):
                b[i, r] -= o[r, 0] * z[0] + o[r, 1] * z[1] + o[r, 2] * z[2]
                b[i, 3 + r] -= f * z[3 + r]
        for r in range(6):
            total = 0.0
            for k in range(6):
                total += w.pivot[i, r, k] * b[i, k]
            t[r] = total
        for r in range(6):
            b[i, r] = t[r]


@helper
def _predict(qs, forces, t, q, force):
    """Start of the iterations: as the last step went on."""
    n = q.shape[0]
    for i in range(n):
        if t == 1:
            q[i] = qs[0, i]
            force[i] = forces[0, i]
            continue
        a, b = qs[t - 2, i], qs[t - 1, i]
        s = 2 * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
        size = 0.0
        for k in range(4):  # b a* b, the turn from a to b once more
            q[i, k] = s * b[k] - a[k]
            size += q[i, k] * q[i, k]
        size = 1.0 / math.sqrt(size)
        for k in range(4):
            q[i, k] *= size
        for k in range(3):
            force[i, k] = forces[t - 1, i, k]


@helper
def _step(rod, drive, t, c0, q, force, w, half, limit):
    """Newton's method on one step, from q and force on. Returns (status, iterations)."""
    n = rod.length.shape[0]
    free = rod.gauge > 0.0 and not rod.loss.any()
    for iteration in range(limit):
        _assemble(rod, drive, t, c0, q, force, w)
        _factor(w, half)
        _solve(w, w.right, half[0])
        turn, change, largest = 0.0, 0.0, 0.0
        # A spin of all segments alike costs nothing here; away from the solution the matrix knows
        # little of it, and the next step would take it for motion.
        spin = w.right[0, 2] if free else 0.0
        for i in range(n):
            w.right[i, 2] -= spin
            for a in range(3):
                turn = max(turn, abs(w.right[i, a]))
                change = max(change, abs(w.right[i, 3 + a]))
                largest = max(largest, abs(force[i, a]))
        if not (math.isfinite(turn) and math.isfinite(change)):
            return NOT_FINITE, iteration
        done = turn < REACH and change < REACH * (largest + change) + 1e-300
        # A step that does not settle soon is one between two valleys: shorter steps get down one.
        # The last is taken whole: a part of it would leave an error of its size, not its square.
        longest = 1.0 if done or iteration < PATIENCE else 0.5 ** (iteration // PATIENCE)
        share = -min(longest, TURN_LIMIT / max(turn, 1e-300))
        for i in range(n):
            _turn(q[i], w.right[i], share, q[i])
            for a in range(3):
                force[i, a] += share * w.right[i, 3 + a]
        if done:
            return CONVERGED, iteration + 1
    return LIMIT, limit


@helper
def _settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w):
    """Factored system and work of the step that ended at time t, from histories of all times."""
    c0, c1, c2 = _rates(drive.time, t)
    two = max(t - 2, 0)
    _past(c1, c2, xs[t - 1], xs[two], w.old_x)
    _past(c1, c2, v[t - 1], v[two], w.old_v)
    _past(c1, c2, p[t - 1, :, 1:], p[two, :, 1:], w.old_p)
    _past(c1, c2, strain[t - 1], strain[two], w.old_strain)
    _prepare(rod, drive, t, c0, w)
    _assemble(rod, drive, t, c0, qs[t], forces[t], w)
    _factor(w, half)


@helper
def _histories(rod, drive, xs, qs, v0, r):
    """Speeds (T, N+1, 3), Darboux quaternions (T, N+1, 4) and strains (T, N, 3) of all times."""
    steps, n = qs.shape[0], qs.shape[1]
    v, p = np.zeros((steps, n + 1, 3)), np.zeros((steps, n + 1, 4))
    strain = np.zeros((steps, n, 3))
    _speeds(drive.time, xs, v0, v)
    for t in range(steps):
        _bend(rod, drive.clamp[t], qs[t], p[t])
        _strain(rod, xs[t], qs[t], r, strain[t])
    return v, p, strain


@helper
def _across(p, d, sign, out):
    """out += B d, the change of the Darboux vector by a turn d behind (sign 1) or before (-1)."""
    h, x, y, z = 0.5 * sign * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    out[0] += h * d[0] - z * d[1] + y * d[2]
    out[1] += z * d[0] + h * d[1] - x * d[2]
    out[2] += -y * d[0] + x * d[1] + h * d[2]


@helper
def _across_back(p, m, sign, out):
    """out += Bᵀ m."""
    h, x, y, z = 0.5 * sign * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    out[0] += h * m[0] + z * m[1] - y * m[2]
    out[1] += -z * m[0] + h * m[1] + x * m[2]
    out[2] += y * m[0] - x * m[1] + h * m[2]


@helper
def _simulate(rod, drive, v0, limit, xs, qs, forces, iterations):
    """One clip. xs, qs, forces hold the first state and receive the others. Returns the status and
    the number of steps done."""
    steps, n = qs.shape[0], qs.shape[1]
    w, half = make_work(n), np.zeros((6, 6))
    v, p, strain = np.zeros((3, n + 1, 3)), np.zeros((3, n + 1, 4)), np.zeros((3, n, 3))
    v[0] = v0
    _bend(rod, drive.clamp[0], qs[0], p[0])
    _strain(rod, xs[0], qs[0], half[:3, :3], strain[0])
    for t in range(1, steps):
        c0, c1, c2 = _rates(drive.time, t)
        now, one, two = t % 3, (t - 1) % 3, (t - 2) % 3
        _past(c1, c2, xs[t - 1], xs[max(t - 2, 0)], w.old_x)
        _past(c1, c2, v[one], v[two], w.old_v)
        _past(c1, c2, p[one, :, 1:], p[two, :, 1:], w.old_p)
        _past(c1, c2, strain[one], strain[two], w.old_strain)
        _predict(qs, forces, t, qs[t], forces[t])
        _prepare(rod, drive, t, c0, w)
        status, count = _step(rod, drive, t, c0, qs[t], forces[t], w, half, limit)
        iterations[t] = count
        if status != CONVERGED:
            return status, t
        for k in range(n + 1):
            for a in range(3):
                pull = 0.0
                if k < n:
                    pull += forces[t, k, a]
                if k > 0:
                    pull -= forces[t, k - 1, a]
                xs[t, k, a] = w.y[k, a] + w.inverse_mass[k] * pull
                v[now, k, a] = c0 * xs[t, k, a] + w.old_x[k, a]
        _bend(rod, drive.clamp[t], qs[t], p[now])
        _strain(rod, xs[t], qs[t], half[:3, :3], strain[now])
    return CONVERGED, steps


@helper
def _tangent(rod, drive, v0, xs, qs, forces, d, dx, turn):
    """Derivatives of one clip: d a Change with P in front; dx (P, T, N+1, 3), turn (P, T, N, 3)."""
    steps, n, many = qs.shape[0], qs.shape[1], dx.shape[0]
    w, half = make_work(n), np.zeros((6, 6))
    v, p, strain = _histories(rod, drive, xs, qs, v0, half[:3, :3])
    dv, dp = np.zeros((many, 3, n + 1, 3)), np.zeros((many, 3, n + 1, 3))
    ds = np.zeros((many, 3, n, 3))
    block = np.zeros((3, 3))
    old_x, old_v, old_p = np.zeros((n + 1, 3)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3))
    old_s, dy, b, edge = np.zeros((n, 3)), np.zeros((n + 1, 3)), np.zeros((n, 6)), np.zeros(3)
    moment = np.zeros(3)
    for t in range(steps):
        c0, c1, c2 = _rates(drive.time, max(t, 1))
        if t > 0:
            _settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w)
        now, one, two = t % 3, (t - 1) % 3, (t - 2) % 3
        for s in range(many):
            if t == 0:
                dx[s, 0], dv[s, 0], turn[s, 0] = d.x0[s], d.v0[s], d.q0[s]
            else:
                _past(c1, c2, dx[s, t - 1], dx[s, max(t - 2, 0)], old_x)
                _past(c1, c2, dv[s, one], dv[s, two], old_v)
                _past(c1, c2, dp[s, one], dp[s, two], old_p)
                _past(c1, c2, ds[s, one], ds[s, two], old_s)
                for k in range(n + 1):
                    end = 0 if k == 0 else 1
                    fixed = (k == 0 or k == n) and drive.held[end]
                    for a in range(3):
                        if fixed:
                            dy[k, a] = d.ends[s, t, end, a]
                            continue
                        acc = c0 * v[t, k, a] + w.old_v[k, a]
                        dy[k, a] = w.inverse_mass[k] * (
                            d.load[s, k, a] - d.mass[s, k] * acc - d.air[s, k] * v[t, k, a]
                            - (rod.mass[k] * c0 + rod.air[k]) * old_x[k, a]
                            - rod.mass[k] * old_v[k, a]
                        )  # fmt: skip
                for i in range(n):
                    r, u, l = w.frame[i], w.u[i], rod.length[i]
                    for a in range(3):
                        supple, vis = rod.supple[i, a], rod.viscous[i, a]
                        even = 1 + supple * vis * c0
                        rate = c0 * (w.g[i, a] / l - (a == 2)) + w.old_strain[i, a]
                        stretch = (
                            d.supple[s, i, a] * (u[a] - vis * w.old_strain[i, a]) / (even * even)
                            - supple / even * (d.viscous[s, i, a] * rate + vis * old_s[i, a])
                        )  # fmt: skip
                        edge[a] = d.length[s, i] * w.g[i, a] / l + l * stretch
                    b[i, 0] = -(edge[1] * u[2] - edge[2] * u[1])
                    b[i, 1] = -(edge[2] * u[0] - edge[0] * u[2])
                    b[i, 2] = -(edge[0] * u[1] - edge[1] * u[0])
                    for a in range(3):
                        b[i, 3 + a] = dy[i + 1, a] - dy[i, a]
                        for c in range(3):
                            b[i, 3 + a] -= r[a, c] * edge[c]
                for j in range(n + 1):
                    if not _jointed(rod.stiff, rod.loss, j):
                        continue
                    pj = w.p[j]
                    for a in range(3):
                        rate = c0 * pj[a + 1] + w.old_p[j, a]
                        moment[a] = (
                            d.stiff[s, j, a] * (pj[a + 1] - rod.rest[j, a + 1])
                            - rod.stiff[j, a] * d.rest[s, j, a]
                            + d.loss[s, j, a] * rate
                            + rod.loss[j, a] * old_p[j, a]
                        )
                    if j < n:
                        _across_back(pj, moment, 1.0, b[j, :3])
                    if j > 0:
                        _across_back(pj, moment, -1.0, b[j - 1, :3])
                    if j == 0:
                        _cross_block(pj, w.m[j], w.firm[j], block)
                        for a in range(3):
                            for c in range(3):
                                b[0, a] += block[c, a] * d.clamp[s, t, 0, c]
                    if j == n:
                        _cross_block(pj, w.m[j], w.firm[j], block)
                        for a in range(3):
                            for c in range(3):
                                b[n - 1, a] += block[a, c] * d.clamp[s, t, 1, c]
                _solve(w, b, half[0])
                for i in range(n):
                    for a in range(3):
                        turn[s, t, i, a] = -b[i, a]
                for k in range(n + 1):
                    for a in range(3):
                        pull = 0.0
                        if k < n:
                            pull -= b[k, 3 + a]
                        if k > 0:
                            pull += b[k - 1, 3 + a]
                        dx[s, t, k, a] = dy[k, a] + w.inverse_mass[k] * pull
                        dv[s, now, k, a] = c0 * dx[s, t, k, a] + old_x[k, a]
            for j in range(n + 1):
                out = dp[s, now, j]
                out[:] = 0.0
                if _jointed(rod.stiff, rod.loss, j):
                    before = d.clamp[s, t, 0] if j == 0 else turn[s, t, j - 1]
                    after = d.clamp[s, t, 1] if j == n else turn[s, t, j]
                    _across(p[t, j], before, -1.0, out)
                    _across(p[t, j], after, 1.0, out)
            for i in range(n):
                _rotation(qs[t, i], block)
                e, z, l = strain[t, i], turn[s, t, i], rod.length[i]
                e0, e1, e2 = e[0], e[1], e[2] + 1
                f = d.length[s, i] / l
                ds[s, now, i, 0] = e1 * z[2] - e2 * z[1] - f * e0
                ds[s, now, i, 1] = e2 * z[0] - e0 * z[2] - f * e1
                ds[s, now, i, 2] = e0 * z[1] - e1 * z[0] - f * e2
                for a in range(3):
                    for c in range(3):
                        gap = dx[s, t, i + 1, c] - dx[s, t, i, c]
                        ds[s, now, i, a] += block[c, a] * gap / l


@helper
def _adjoint(rod, drive, v0, xs, qs, forces, gx, gq, out):
    """Pull gradients gx (T, N+1, 3) and gq (T, N, 3), in turns, back into `out`, a Change. gx and
    gq are used up."""
    steps, n = qs.shape[0], qs.shape[1]
    w, half = make_work(n), np.zeros((6, 6))
    v, p, strain = _histories(rod, drive, xs, qs, v0, half[:3, :3])
    gv, gp = np.zeros((steps, n + 1, 3)), np.zeros((steps, n + 1, 3))
    gs, b = np.zeros((steps, n, 3)), np.zeros((n, 6))
    block, mu, pull = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    for t in range(steps - 1, -1, -1):
        c0, c1, c2 = _rates(drive.time, max(t, 1))
        two = max(t - 2, 0)
        for i in range(n):  # Γ of this time
            _rotation(qs[t, i], block)
            s, e, l = gs[t, i], strain[t, i], rod.length[i]
            e0, e1, e2 = e[0], e[1], e[2] + 1
            gq[t, i, 0] += s[1] * e2 - s[2] * e1
            gq[t, i, 1] += s[2] * e0 - s[0] * e2
            gq[t, i, 2] += s[0] * e1 - s[1] * e0
            out.length[i] -= (s[0] * e0 + s[1] * e1 + s[2] * e2) / l
            for c in range(3):
                total = (block[c, 0] * s[0] + block[c, 1] * s[1] + block[c, 2] * s[2]) / l
                gx[t, i + 1, c] += total
                gx[t, i, c] -= total
        for j in range(n + 1):  # p of this time
            if _jointed(rod.stiff, rod.loss, j):
                before = out.clamp[t, 0] if j == 0 else gq[t, j - 1]
                after = out.clamp[t, 1] if j == n else gq[t, j]
                _across_back(p[t, j], gp[t, j], -1.0, before)
                _across_back(p[t, j], gp[t, j], 1.0, after)
        if t == 0:
            break
        _settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w)
        for k in range(n + 1):  # v of this time
            for a in range(3):
                gx[t, k, a] += c0 * gv[t, k, a]
                gx[t - 1, k, a] += c1 * gv[t, k, a]
                gx[two, k, a] += c2 * gv[t, k, a]
        for i in range(n):
            for a in range(3):
                b[i, a] = -gq[t, i, a]
                b[i, 3 + a] = (
                    w.inverse_mass[i + 1] * gx[t, i + 1, a] - w.inverse_mass[i] * gx[t, i, a]
                )
        _solve(w, b, half[0])
        for k in range(n + 1):
            end = 0 if k == 0 else 1
            fixed = (k == 0 or k == n) and drive.held[end]
            for a in range(3):
                total = gx[t, k, a]
                if k < n:
                    total -= b[k, 3 + a]
                if k > 0:
                    total += b[k - 1, 3 + a]
                if fixed:
                    out.ends[t, end, a] += total
                    continue
                s = w.inverse_mass[k] * total
                out.load[k, a] += s
                out.mass[k] -= s * (c0 * v[t, k, a] + w.old_v[k, a])
                out.air[k] -= s * v[t, k, a]
                drag = (rod.mass[k] * c0 + rod.air[k]) * s
                gx[t - 1, k, a] -= c1 * drag
                gx[two, k, a] -= c2 * drag
                gv[t - 1, k, a] -= c1 * rod.mass[k] * s
                gv[two, k, a] -= c2 * rod.mass[k] * s
        for i in range(n):
            r, u, l = w.frame[i], w.u[i], rod.length[i]
            m0, m1, m2 = b[i, 0], b[i, 1], b[i, 2]
            pull[0] = u[1] * m2 - u[2] * m1
            pull[1] = u[2] * m0 - u[0] * m2
            pull[2] = u[0] * m1 - u[1] * m0
            for a in range(3):
                pull[a] += r[0, a] * b[i, 3] + r[1, a] * b[i, 4] + r[2, a] * b[i, 5]
                supple, vis = rod.supple[i, a], rod.viscous[i, a]
                even = 1 + supple * vis * c0
                rate = c0 * (w.g[i, a] / l - (a == 2)) + w.old_strain[i, a]
                g = -l * pull[a]
                out.length[i] -= w.g[i, a] / l * pull[a]
                out.supple[i, a] += g * (u[a] - vis * w.old_strain[i, a]) / (even * even)
                out.viscous[i, a] -= g * supple / even * rate
                gs[t - 1, i, a] -= c1 * g * supple / even * vis
                gs[two, i, a] -= c2 * g * supple / even * vis
        for j in range(n + 1):
            if not _jointed(rod.stiff, rod.loss, j):
                continue
            pj = w.p[j]
            mu[:] = 0.0
            if j > 0:
                _across(pj, b[j - 1, :3], -1.0, mu)
            if j < n:
                _across(pj, b[j, :3], 1.0, mu)
            for a in range(3):
                out.stiff[j, a] += mu[a] * (pj[a + 1] - rod.rest[j, a + 1])
                out.loss[j, a] += mu[a] * (c0 * pj[a + 1] + w.old_p[j, a])
                out.rest[j, a] -= mu[a] * rod.stiff[j, a]
                gp[t - 1, j, a] += c1 * rod.loss[j, a] * mu[a]
                gp[two, j, a] += c2 * rod.loss[j, a] * mu[a]
            if j == 0 or j == n:
                _cross_block(pj, w.m[j], w.firm[j], block)
                for a in range(3):
                    for c in range(3):
                        if j == 0:
                            out.clamp[t, 0, a] += block[a, c] * b[0, c]
                        else:
                            out.clamp[t, 1, a] += block[c, a] * b[n - 1, c]
    out.x0[:] = gx[0]
    out.v0[:] = gv[0]
    out.q0[:] = gq[0]


# --- Entry points --------------------------------------------------------------------------------


@helper
def _rod(rods, k):
    return Rod(
        rods.length[k], rods.supple[k], rods.viscous[k], rods.stiff[k], rods.loss[k],
        rods.rest[k], rods.load[k], rods.mass[k], rods.air[k], rods.gauge[k],
    )  # fmt: skip


@helper
def _drive(drives, k):
    return Drive(drives.time[k], drives.ends[k], drives.clamp[k], drives.held)


@helper
def _change(c, k, of):
    """The change of clip k that shows rope `of`."""
    return Change(
        c.length[of], c.supple[of], c.viscous[of], c.stiff[of], c.loss[of], c.rest[of],
        c.load[of], c.mass[of], c.air[of], c.ends[k], c.clamp[k], c.x0[k], c.v0[k], c.q0[k],
    )  # fmt: skip


def _entries(shared):
    """The entry points. `shared`, of the source they call, makes the cache notice its changes."""

    @kernel
    def simulate(rods, of, drives, v0, limit, xs, qs, forces, iterations, status, done):
        """C clips; of (C,): which rope each shows. xs[:, 0], qs[:, 0], forces[:, 0]: the start."""
        assert shared != 0
        for k in range(qs.shape[0]):
            status[k], done[k] = _simulate(
                _rod(rods, of[k]), _drive(drives, k), v0[k], limit, xs[k], qs[k], forces[k],
                iterations[k],
            )  # fmt: skip

    @kernel
    def tangent(rods, of, drives, v0, xs, qs, forces, change, dx, turn):
        """Forward derivatives in P directions: change of R ropes and C clips with P behind."""
        assert shared != 0
        for k in range(qs.shape[0]):
            _tangent(
                _rod(rods, of[k]), _drive(drives, k), v0[k], xs[k], qs[k], forces[k],
                _change(change, k, of[k]), dx[k], turn[k],
            )  # fmt: skip

    @kernel
    def adjoint(rods, of, drives, v0, xs, qs, forces, gx, gq, out):
        """Gradients: `out` of C clips, also in what belongs to the ropes."""
        assert shared != 0
        for k in range(qs.shape[0]):
            _adjoint(
                _rod(rods, of[k]), _drive(drives, k), v0[k], xs[k], qs[k], forces[k], gx[k], gq[k],
                _change(out, k, k),
            )  # fmt: skip

    return simulate, tangent, adjoint


simulate_clips, tangent_clips, adjoint_clips = _entries(
    crc32(Path(newton_kernels.__file__).read_bytes())
)
