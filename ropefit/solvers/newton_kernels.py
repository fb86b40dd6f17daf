"""Newton's method on the equilibrium of one rope after the other, compiled; see `equilibrium.py`.

Unknown are the turns δ of the N segments about their own directors (q <- q exp δ/2), the force λ_s
of each support, and where node 0 is if nothing holds it. Everything else follows without error:
the force in segment i is n_i = Σ_{k>i} f_k + Σ_{k_s>i} λ_s d_s, its strain is D Rᵀ n_i, and the
nodes are x_k = x_0 + Σ_{i<k} R_i g_i with g = l (e3 + D u), u = Rᵀ n. So an inextensible rope
(D = 0) is no harder than any other. The solution is the saddle point of

    L = Σ_j bend_j - Σ_i l_i (u3 + u·D u / 2) + Σ_s (λ_s (y_s - d_s·x_0) - c_s λ_s²/2) - x_0·Σ_k f_k

whose derivative in δ is the balance of moments, in λ_s the support's condition d·x + c λ = y. Its
Hessian is block tridiagonal (3 x 3) with a border of one column a support: linear cost in N.

All compiled code is in this one file, because numba's cache notices only changes of the file that
holds the entry points (`solve_ropes`, `tangent_ropes`, `adjoint_ropes`, `stability_ropes`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

FUSED = {"contract"}  # a multiplication and an addition may be one instruction
helper = njit(error_model="numpy", fastmath=FUSED)
small = njit(error_model="numpy", inline="always", fastmath=FUSED)
kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath=FUSED)

CONVERGED, LIMIT, STUCK, NOT_FINITE, UNSTABLE = range(5)
TURN_LIMIT = 1.2  # rad: largest turn of a segment in one step
REACH = 1e-5  # rad: a last full step below it leaves an error of its square
# Of the largest entry of the Hessian: what a rope is indifferent to (a buckled strut may turn about
# the line through its ends) has an eigenvalue of either sign in rounding.
NEUTRAL = 1e-9
NEAR = 1e-3  # of the largest moment: a residual below it may be that of such a state


class Rod(NamedTuple):
    """One rope: length (N,) [m], supple (N, 3) [1/N] = 1/GA, 1/GA, 1/EA, stiff (N+1, 3) [N m],
    rest (N+1, 4), load (N+1, 3) [N], moment (2, 3) [N m], gauge [N m] (see `_assemble`)."""

    length: np.ndarray
    supple: np.ndarray
    stiff: np.ndarray
    rest: np.ndarray
    load: np.ndarray
    moment: np.ndarray
    gauge: float


class Held(NamedTuple):
    """One frame's conditions: clamp (2, 4); supports: node (S,), direction (S, 3), offset (S,) [m],
    compliance (S,) [m/N], active (S,); free: nothing holds node 0. B sliders: springs drag (B, N+1)
    [N m] in bending towards centre (B, N+1, 2) that slip where they are longer than slip (B,
    N+1)."""

    clamp: np.ndarray
    node: np.ndarray
    direction: np.ndarray
    offset: np.ndarray
    compliance: np.ndarray
    active: np.ndarray
    free: bool
    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray


class Work(NamedTuple):
    """Scratch of one rope. border (N, 3, S + 1): columns of the supports, last the residual."""

    force: np.ndarray  # n, world
    u: np.ndarray
    g: np.ndarray
    frame: np.ndarray  # R (N, 3, 3)
    x: np.ndarray
    p: np.ndarray  # Darboux quaternion of each bend element
    m: np.ndarray  # its moment
    k: np.ndarray  # its stiffness, sliders included
    coupling: np.ndarray  # its stiffness between bending about the first and the second director
    diagonal: np.ndarray
    off: np.ndarray
    inverse: np.ndarray
    border: np.ndarray
    solved: np.ndarray
    corner: np.ndarray  # second derivative of L in (λ, x_0)
    rest: np.ndarray  # residual of the supports and of the total force


@helper
def make_work(n, s, extra):
    """Scratch for n segments, s supports and `extra` right hand sides."""
    return Work(
        np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3, 3)),
        np.zeros((n + 1, 3)), np.zeros((n + 1, 4)), np.zeros((n + 1, 3)), np.zeros((n + 1, 3)),
        np.zeros(n + 1), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3, 3)),
        np.zeros((n, 3, s + extra)), np.zeros((n, 3, s + extra)), np.zeros((s + 3, s + 3)),
        np.zeros(s + 3),
    )  # fmt: skip


# --- Geometry ------------------------------------------------------------------------------------


@helper
def _rotation(q, r):
    """R(q) into r (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@helper
def _turn(q, d, share, out):
    """out = q exp(share d / 2), normalised."""
    a, b, c = share * d[0], share * d[1], share * d[2]
    angle = math.sqrt(a * a + b * b + c * c)
    f = 0.5 if angle < 1e-8 else math.sin(0.5 * angle) / angle
    w, x, y, z = math.cos(0.5 * angle), f * a, f * b, f * c
    o0 = q[0] * w - q[1] * x - q[2] * y - q[3] * z
    o1 = q[0] * x + q[1] * w + q[2] * z - q[3] * y
    o2 = q[0] * y - q[1] * z + q[2] * w + q[3] * x
    o3 = q[0] * z + q[1] * y - q[2] * x + q[3] * w
    size = 1.0 / math.sqrt(o0 * o0 + o1 * o1 + o2 * o2 + o3 * o3)
    out[0], out[1], out[2], out[3] = o0 * size, o1 * size, o2 * size, o3 * size


@small
def _darboux(a, b, rest, p):
    """p = a* b, of the sign that lies nearer to the rest rotation."""
    p0 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    p1 = a[0] * b[1] - b[0] * a[1] - (a[2] * b[3] - a[3] * b[2])
    p2 = a[0] * b[2] - b[0] * a[2] - (a[3] * b[1] - a[1] * b[3])
    p3 = a[0] * b[3] - b[0] * a[3] - (a[1] * b[2] - a[2] * b[1])
    s = 1.0
    if p0 * rest[0] + p1 * rest[1] + p2 * rest[2] + p3 * rest[3] < 0:
        s = -1.0
    p[0], p[1], p[2], p[3] = s * p0, s * p1, s * p2, s * p3


@helper
def _state(rod, held, q, lam, x0, w):
    """Forces, strains, nodes, moments of a state; returns L."""
    n = rod.length.shape[0]
    f0, f1, f2 = 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        f0 += rod.load[i + 1, 0]
        f1 += rod.load[i + 1, 1]
        f2 += rod.load[i + 1, 2]
        for s in range(held.node.shape[0]):
            if held.node[s] == i + 1 and held.active[s]:
                f0 += lam[s] * held.direction[s, 0]
                f1 += lam[s] * held.direction[s, 1]
                f2 += lam[s] * held.direction[s, 2]
        w.force[i, 0], w.force[i, 1], w.force[i, 2] = f0, f1, f2
    total = 0.0
    for a in range(3):
        w.x[0, a] = x0[a]
    for i in range(n):
        r = w.frame[i]
        _rotation(q[i], r)
        l = rod.length[i]
        for a in range(3):
            u = r[0, a] * w.force[i, 0] + r[1, a] * w.force[i, 1] + r[2, a] * w.force[i, 2]
            w.u[i, a] = u
            w.g[i, a] = l * rod.supple[i, a] * u
            total -= 0.5 * l * rod.supple[i, a] * u * u
        w.g[i, 2] += l
        total -= l * w.u[i, 2]
        for a in range(3):
            w.x[i + 1, a] = (
                w.x[i, a] + r[a, 0] * w.g[i, 0] + r[a, 1] * w.g[i, 1] + r[a, 2] * w.g[i, 2]
            )
    for j in range(n + 1):
        k = rod.stiff[j]
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            w.m[j, 0], w.m[j, 1], w.m[j, 2] = 0.0, 0.0, 0.0
            continue
        before = held.clamp[0] if j == 0 else q[j - 1]
        after = held.clamp[1] if j == n else q[j]
        _darboux(before, after, rod.rest[j], w.p[j])
        for a in range(3):
            c = w.p[j, a + 1] - rod.rest[j, a + 1]
            w.m[j, a] = k[a] * c
            w.k[j, a] = k[a]
            total += 0.5 * k[a] * c * c
        if held.drag.shape[0] > 0:
            w.coupling[j] = 0.0
            for b in range(held.drag.shape[0]):
                total += _slide(held, b, j, w)
    for s in range(held.node.shape[0]):
        if held.active[s]:
            d = held.direction[s]
            along = d[0] * x0[0] + d[1] * x0[1] + d[2] * x0[2]
            total += lam[s] * (held.offset[s] - along) - 0.5 * held.compliance[s] * lam[s] ** 2
    if held.free:
        for k in range(n + 1):
            for a in range(3):
                total -= x0[a] * rod.load[k, a]
    return total


@helper
def _slide(held, b, j, w):
    """Adds slider b's moment and stiffness to those of bend element j; returns its energy.

    Its force is drag times its length, and no longer grows where that exceeds slip.
    """
    k, most = held.drag[b, j], held.slip[b, j]
    d0, d1 = w.p[j, 1] - held.centre[b, j, 0], w.p[j, 2] - held.centre[b, j, 1]
    size = math.sqrt(d0 * d0 + d1 * d1)
    if size <= most:
        w.m[j, 0] += k * d0
        w.m[j, 1] += k * d1
        w.k[j, 0] += k
        w.k[j, 1] += k
        return 0.5 * k * size * size
    f = k * most / size
    n0, n1 = d0 / size, d1 / size
    w.m[j, 0] += f * d0
    w.m[j, 1] += f * d1
    w.k[j, 0] += f * n1 * n1
    w.k[j, 1] += f * n0 * n0
    w.coupling[j] -= f * n0 * n1
    return k * most * (size - 0.5 * most)


@helper
def _conditions(rod, held, lam, w, out):
    """Derivative of L in λ and x_0 into out; returns its square in the supports [m²]."""
    square = 0.0
    count = held.node.shape[0]
    for s in range(count):
        out[s] = 0.0
        if held.active[s]:
            d, x = held.direction[s], w.x[held.node[s]]
            gap = held.offset[s] - d[0] * x[0] - d[1] * x[1] - d[2] * x[2]
            out[s] = gap - held.compliance[s] * lam[s]
            square += out[s] ** 2
    for a in range(3):
        out[count + a] = 0.0
        if held.free:
            for k in range(rod.load.shape[0]):
                out[count + a] -= rod.load[k, a]
            for s in range(count):
                if held.active[s]:
                    out[count + a] -= lam[s] * held.direction[s, a]
    return square


# --- Hessian -------------------------------------------------------------------------------------


@helper
def _assemble(rod, held, lam, w):
    """Gradient and Hessian of L at the state last given to `_state`.

    A rope that may spin about its own tangent (no twist held, straight isotropic rest) has one
    direction without stiffness: `gauge` holds the spin of segment 0, which moves nothing else.
    Returns the largest moment that is balanced, for judging the residual, and the residual.
    """
    n, count = rod.length.shape[0], held.node.shape[0]
    w.diagonal[:] = 0.0
    w.off[:] = 0.0
    last = count  # the column of the residual
    sliding = held.drag.shape[0] > 0
    scale = 0.0
    for i in range(n):
        u, g = w.u[i], w.g[i]
        l = rod.length[i]
        d0, d1, d2 = l * rod.supple[i, 0], l * rod.supple[i, 1], l * rod.supple[i, 2]
        b = w.border[i]
        b[0, last] = -(g[1] * u[2] - g[2] * u[1])
        b[1, last] = -(g[2] * u[0] - g[0] * u[2])
        b[2, last] = -(g[0] * u[1] - g[1] * u[0])
        size = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        scale = max(scale, size)
        gu = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
        a = w.diagonal[i]
        a[0, 0] = gu - g[0] * u[0] - (u[2] * u[2] * d1 + u[1] * u[1] * d2)
        a[1, 1] = gu - g[1] * u[1] - (u[2] * u[2] * d0 + u[0] * u[0] * d2)
        a[2, 2] = gu - g[2] * u[2] - (u[1] * u[1] * d0 + u[0] * u[0] * d1)
        a[0, 1] = -0.5 * (g[0] * u[1] + g[1] * u[0]) + u[0] * u[1] * d2
        a[0, 2] = -0.5 * (g[0] * u[2] + g[2] * u[0]) + u[0] * u[2] * d1
        a[1, 2] = -0.5 * (g[1] * u[2] + g[2] * u[1]) + u[1] * u[2] * d0
        a[1, 0], a[2, 0], a[2, 1] = a[0, 1], a[0, 2], a[1, 2]
        r = w.frame[i]
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                d = held.direction[s]
                v0 = r[0, 0] * d[0] + r[1, 0] * d[1] + r[2, 0] * d[2]
                v1 = r[0, 1] * d[0] + r[1, 1] * d[1] + r[2, 1] * d[2]
                v2 = r[0, 2] * d[0] + r[1, 2] * d[1] + r[2, 2] * d[2]
                e0, e1, e2 = d0 * v0, d1 * v1, d2 * v2
                b[0, s] = -(e1 * u[2] - e2 * u[1] + g[1] * v2 - g[2] * v1)
                b[1, s] = -(e2 * u[0] - e0 * u[2] + g[2] * v0 - g[0] * v2)
                b[2, s] = -(e0 * u[1] - e1 * u[0] + g[0] * v1 - g[1] * v0)
            else:
                b[0, s], b[1, s], b[2, s] = 0.0, 0.0, 0.0
    for j in range(n + 1):
        k = rod.stiff[j]
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        p, m = w.p[j], w.m[j]
        now = w.k[j]
        scale = max(scale, m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
        # Rounding in a frame costs this much, also where nothing is bent.
        scale = max(scale, 1e-8 * max(k[0], k[1], k[2]) ** 2)
        c0 = 0.5 * (p[2] * m[2] - p[3] * m[1])
        c1 = 0.5 * (p[3] * m[0] - p[1] * m[2])
        c2 = 0.5 * (p[1] * m[1] - p[2] * m[0])
        h = 0.5 * p[0]
        bend = 0.25 * (m[0] * p[1] + m[1] * p[2] + m[2] * p[3])
        x, y, z = 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
        # Rows of B2 = h + [v]x and of B1 = -h + [v]x with v = (x, y, z).
        if j < n:
            b = w.border[j]
            b[0, last] += h * m[0] - c0
            b[1, last] += h * m[1] - c1
            b[2, last] += h * m[2] - c2
            _add_square(w.diagonal[j], now, h, x, y, z, bend)
            if sliding:
                _couple(w.coupling[j], p, 1.0, 1.0, w.diagonal[j])
        if j > 0:
            b = w.border[j - 1]
            b[0, last] += -h * m[0] - c0
            b[1, last] += -h * m[1] - c1
            b[2, last] += -h * m[2] - c2
            _add_square(w.diagonal[j - 1], now, -h, x, y, z, bend)
            if sliding:
                _couple(w.coupling[j], p, -1.0, -1.0, w.diagonal[j - 1])
        if 0 < j < n:
            _cross_block(p, m, now, w.off[j - 1])
            if sliding:
                _couple(w.coupling[j], p, -1.0, 1.0, w.off[j - 1])
    for end in range(2):
        moment = rod.moment[end]
        if moment[0] != 0.0 or moment[1] != 0.0 or moment[2] != 0.0:
            i = 0 if end == 0 else n - 1
            r, a = w.frame[i], w.diagonal[i]
            t0 = r[0, 0] * moment[0] + r[1, 0] * moment[1] + r[2, 0] * moment[2]
            t1 = r[0, 1] * moment[0] + r[1, 1] * moment[1] + r[2, 1] * moment[2]
            t2 = r[0, 2] * moment[0] + r[1, 2] * moment[1] + r[2, 2] * moment[2]
            w.border[i, 0, last] -= t0
            w.border[i, 1, last] -= t1
            w.border[i, 2, last] -= t2
            # A moment that keeps its direction in space has no potential: not symmetric.
            a[0, 1] += 0.5 * t2
            a[0, 2] -= 0.5 * t1
            a[1, 0] -= 0.5 * t2
            a[1, 2] += 0.5 * t0
            a[2, 0] += 0.5 * t1
            a[2, 1] -= 0.5 * t0
            scale = max(scale, t0 * t0 + t1 * t1 + t2 * t2)
    w.diagonal[0, 2, 2] += rod.gauge
    worst = 0.0
    for i in range(n):
        for a in range(3):
            worst = max(worst, abs(w.border[i, a, last]))
            if not math.isfinite(w.border[i, a, last]):
                worst = np.inf
    return math.sqrt(scale), worst


@small
def _add_square(a, k, h, x, y, z, bend):
    """a += Bᵀ diag(k) B - bend, with B = h + [v]x."""
    k0, k1, k2 = k[0], k[1], k[2]
    a[0, 0] += k0 * h * h + k1 * z * z + k2 * y * y - bend
    a[1, 1] += k0 * z * z + k1 * h * h + k2 * x * x - bend
    a[2, 2] += k0 * y * y + k1 * x * x + k2 * h * h - bend
    s01 = -k0 * h * z + k1 * z * h - k2 * y * x
    s02 = k0 * h * y - k1 * z * x - k2 * y * h
    s12 = -k0 * z * y - k1 * h * x + k2 * x * h
    a[0, 1] += s01
    a[1, 0] += s01
    a[0, 2] += s02
    a[2, 0] += s02
    a[1, 2] += s12
    a[2, 1] += s12


@helper
def _couple(c, p, before, after, out):
    """out += Bᵀ C B for the stiffness c between the first two directions of bending; before and
    after: -1 for B1, 1 for B2."""
    if c == 0.0:
        return
    h, x, y, z = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    a0, a1 = (before * h, -z, y), (z, before * h, -x)
    b0, b1 = (after * h, -z, y), (z, after * h, -x)
    for i in range(3):
        for j in range(3):
            out[i, j] += c * (a0[i] * b1[j] + a1[i] * b0[j])


@helper
def _cross(w, j, out):
    """out (3, 3): second derivative in the turns before and after bend element j."""
    _cross_block(w.p[j], w.m[j], w.k[j], out)
    _couple(w.coupling[j], w.p[j], -1.0, 1.0, out)


@helper
def _cross_block(p, m, k, out):
    """out (3, 3) = B1ᵀ diag(k) B2 - M/4, second derivative in the turns before and after."""
    h = 0.5 * p[0]
    x, y, z = 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    k0, k1, k2 = k[0], k[1], k[2]
    # B = h + [v]x has rows (h, -z, y), (z, h, -x), (-y, x, h).
    mp = 0.25 * (m[0] * p[1] + m[1] * p[2] + m[2] * p[3])
    q0 = 0.25 * p[0]
    out[0, 0] = -k0 * h * h + k1 * z * z + k2 * y * y - mp + 0.5 * p[1] * m[0]
    out[1, 1] = k0 * z * z - k1 * h * h + k2 * x * x - mp + 0.5 * p[2] * m[1]
    out[2, 2] = k0 * y * y + k1 * x * x - k2 * h * h - mp + 0.5 * p[3] * m[2]
    s01 = 0.25 * (p[1] * m[1] + m[0] * p[2])
    s02 = 0.25 * (p[1] * m[2] + m[0] * p[3])
    s12 = 0.25 * (p[2] * m[2] + m[1] * p[3])
    out[0, 1] = k0 * h * z + k1 * z * h - k2 * y * x + s01 - q0 * m[2]
    out[1, 0] = -k0 * z * h - k1 * h * z - k2 * x * y + s01 + q0 * m[2]
    out[0, 2] = -k0 * h * y - k1 * z * x - k2 * y * h + s02 + q0 * m[1]
    out[2, 0] = k0 * y * h - k1 * x * z + k2 * h * y + s02 - q0 * m[1]
    out[1, 2] = -k0 * z * y + k1 * h * x + k2 * x * h + s12 - q0 * m[0]
    out[2, 1] = -k0 * y * z - k1 * x * h - k2 * h * x + s12 + q0 * m[0]


@helper
def _corner(rod, held, w):
    """Second derivative of L in (λ, x_0), without the border's share."""
    count = held.node.shape[0]
    c = w.corner
    c[:] = 0.0
    for s in range(count):
        if not held.active[s]:
            c[s, s] = -1.0
            continue
        for t in range(s + 1):
            if not held.active[t]:
                continue
            total = 0.0
            ds, dt = held.direction[s], held.direction[t]
            for i in range(min(held.node[s], held.node[t])):
                r = w.frame[i]
                for a in range(3):
                    if rod.supple[i, a] != 0.0:
                        vs = r[0, a] * ds[0] + r[1, a] * ds[1] + r[2, a] * ds[2]
                        vt = r[0, a] * dt[0] + r[1, a] * dt[1] + r[2, a] * dt[2]
                        total += rod.length[i] * rod.supple[i, a] * vs * vt
            c[s, t] = -total
            c[t, s] = -total
        c[s, s] -= held.compliance[s]
    for a in range(3):
        if held.free:
            for s in range(count):
                if held.active[s]:
                    c[s, count + a] = -held.direction[s, a]
                    c[count + a, s] = -held.direction[s, a]
        else:
            c[count + a, count + a] = -1.0


@helper
def _factor(w, shift, mass, length):
    """Invert the pivots of A + shift + mass diag(l); returns how many of their signs are
    negative."""
    negative = 0
    n = w.diagonal.shape[0]
    for i in range(n):
        add = shift + mass * length[i]
        a = w.diagonal[i]
        m00, m11, m22 = a[0, 0] + add, a[1, 1] + add, a[2, 2] + add
        m01, m02, m12 = a[0, 1], a[0, 2], a[1, 2]
        m10, m20, m21 = a[1, 0], a[2, 0], a[2, 1]
        if i > 0:
            o, v = w.off[i - 1], w.inverse[i - 1]
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
            m00 -= o[0, 0] * t00 + o[1, 0] * t10 + o[2, 0] * t20
            m01 -= o[0, 0] * t01 + o[1, 0] * t11 + o[2, 0] * t21
            m02 -= o[0, 0] * t02 + o[1, 0] * t12 + o[2, 0] * t22
            m10 -= o[0, 1] * t00 + o[1, 1] * t10 + o[2, 1] * t20
            m11 -= o[0, 1] * t01 + o[1, 1] * t11 + o[2, 1] * t21
            m12 -= o[0, 1] * t02 + o[1, 1] * t12 + o[2, 1] * t22
            m20 -= o[0, 2] * t00 + o[1, 2] * t10 + o[2, 2] * t20
            m21 -= o[0, 2] * t01 + o[1, 2] * t11 + o[2, 2] * t21
            m22 -= o[0, 2] * t02 + o[1, 2] * t12 + o[2, 2] * t22
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
        minor = c22
        if m00 < 0:
            negative += 1
        if (minor < 0) != (m00 < 0):
            negative += 1
        if (det < 0) != (minor < 0):
            negative += 1
        f = 1.0 / det
        v = w.inverse[i]
        v[0, 0], v[0, 1], v[0, 2] = c00 * f, c01 * f, c02 * f
        v[1, 0], v[1, 1], v[1, 2] = c10 * f, c11 * f, c12 * f
        v[2, 0], v[2, 1], v[2, 2] = c20 * f, c21 * f, c22 * f
    return negative


@helper
def _solve(w, columns, transposed):
    """solved[..., :columns] = A⁻¹ border[..., :columns] (or A⁻ᵀ), with the factors in `inverse`."""
    n = w.diagonal.shape[0]
    z, b = w.solved, w.border
    for i in range(n):
        for c in range(columns):
            r0, r1, r2 = b[i, 0, c], b[i, 1, c], b[i, 2, c]
            if i > 0:
                o = w.off[i - 1]
                y0, y1, y2 = z[i - 1, 0, c], z[i - 1, 1, c], z[i - 1, 2, c]
                r0 -= o[0, 0] * y0 + o[1, 0] * y1 + o[2, 0] * y2
                r1 -= o[0, 1] * y0 + o[1, 1] * y1 + o[2, 1] * y2
                r2 -= o[0, 2] * y0 + o[1, 2] * y1 + o[2, 2] * y2
            _apply(w.inverse[i], r0, r1, r2, z, i, c, transposed, 1.0)
    for i in range(n - 2, -1, -1):
        o = w.off[i]
        for c in range(columns):
            y0, y1, y2 = z[i + 1, 0, c], z[i + 1, 1, c], z[i + 1, 2, c]
            r0 = o[0, 0] * y0 + o[0, 1] * y1 + o[0, 2] * y2
            r1 = o[1, 0] * y0 + o[1, 1] * y1 + o[1, 2] * y2
            r2 = o[2, 0] * y0 + o[2, 1] * y1 + o[2, 2] * y2
            _apply(w.inverse[i], r0, r1, r2, z, i, c, transposed, -1.0)


@small
def _apply(v, r0, r1, r2, z, i, c, transposed, sign):
    """z[i, :, c] = v r for sign 1, z[i, :, c] -= v r for sign -1 (v transposed if asked)."""
    if transposed:
        s0 = v[0, 0] * r0 + v[1, 0] * r1 + v[2, 0] * r2
        s1 = v[0, 1] * r0 + v[1, 1] * r1 + v[2, 1] * r2
        s2 = v[0, 2] * r0 + v[1, 2] * r1 + v[2, 2] * r2
    else:
        s0 = v[0, 0] * r0 + v[0, 1] * r1 + v[0, 2] * r2
        s1 = v[1, 0] * r0 + v[1, 1] * r1 + v[1, 2] * r2
        s2 = v[2, 0] * r0 + v[2, 1] * r1 + v[2, 2] * r2
    if sign > 0:
        z[i, 0, c], z[i, 1, c], z[i, 2, c] = s0, s1, s2
    else:
        z[i, 0, c] -= s0
        z[i, 1, c] -= s1
        z[i, 2, c] -= s2


@helper
def _schur(w, count, out):
    """out = corner - borderᵀ A⁻¹ border for the first `count` columns, already solved."""
    n = w.diagonal.shape[0]
    size = count + 3
    for s in range(size):
        for t in range(size):
            out[s, t] = w.corner[s, t]
    for s in range(count):
        for t in range(count):
            total = 0.0
            for i in range(n):
                total += (
                    w.border[i, 0, s] * w.solved[i, 0, t]
                    + w.border[i, 1, s] * w.solved[i, 1, t]
                    + w.border[i, 2, s] * w.solved[i, 2, t]
                )
            out[s, t] -= total


@helper
def _solve_border(matrix, right):
    """Solve matrix y = right, y in the place of right; False when singular."""
    try:
        y = np.linalg.solve(matrix, right)
    except (
        Exception
    ):  # the compiler knows no narrower one; it can only be that of a singular matrix
        return False
    right[:] = y
    return True


@helper
def _unstable_directions(w, held, negative, schur):
    """How many directions allowed by the supports lower the energy.

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
            if not math.isfinite(schur[s, t]):
                return 1
    values = np.linalg.eigvalsh(np.ascontiguousarray(schur[:size, :size]))
    found = negative
    for s in range(size):
        if values[s] < 0:
            found += 1
    for s in range(count):
        if not held.active[s]:
            found -= 1
    return found - expected


@helper
def _system(rod, held, w, shift, mass, schur):
    """Factor, solve all support columns and the residual's; returns the descent directions."""
    count = held.node.shape[0]
    negative = _factor(w, shift, mass, rod.length)
    _solve(w, count + 1, False)
    _schur(w, count, schur)
    return _unstable_directions(w, held, negative, schur)


# --- Newton --------------------------------------------------------------------------------------


@helper
def _solve_rope(rod, held, q, lam, x0, tolerance, limit, w):
    """Newton from q, λ, x_0 (changed in place).

    Returns status, iterations, residual. The step is that of sequential quadratic programming: the
    Hessian is shifted until the energy is convex along the supports, and the step shortened until
    the augmented Lagrangian decreases.
    """
    n, count = rod.length.shape[0], held.node.shape[0]
    whole = 0.0
    for i in range(n):
        whole += rod.length[i]
    trial_q, trial_x = np.empty((n, 4)), np.empty(3)
    schur = np.empty((count + 3, count + 3))
    right = np.empty((count + 3, 1))
    next_lam = np.empty(count)
    turn = np.empty((n, 3))
    gaps = np.empty(count + 3)
    shift, last_step, kicks = 0.0, np.inf, 0
    worst, known, energy = np.inf, False, 0.0
    for iteration in range(limit):
        if not known:
            energy = _state(rod, held, q, lam, x0, w)
        known = False
        scale, residual = _assemble(rod, held, lam, w)
        gap = math.sqrt(_conditions(rod, held, lam, w, w.rest))
        push, bear = 0.0, 0.0
        if held.free:
            for a in range(3):
                push = max(push, abs(w.rest[count + a]))
            for k in range(n + 1):
                bear += abs(rod.load[k, 0]) + abs(rod.load[k, 1]) + abs(rod.load[k, 2])
        worst = max(residual / max(scale, 1e-300), gap / whole, push / max(bear, 1e-300))
        if not math.isfinite(worst):
            return NOT_FINITE, iteration, worst
        _corner(rod, held, w)
        descent = _system(rod, held, w, 0.0, 0.0, schur)
        used, size = 0.0, 0.0
        if descent > 0:
            for i in range(n):
                for a in range(3):
                    size = max(size, abs(w.diagonal[i, a, a]))
            if worst < NEAR:
                used = NEUTRAL * size
                descent = _system(rod, held, w, used, 0.0, schur)
        if worst < tolerance and (last_step < REACH or worst < 1e-3 * tolerance):
            if descent <= 0:
                return CONVERGED, iteration, worst
            if kicks == 3:
                return UNSTABLE, iteration, worst
            kicks += 1
            last_step = np.inf
            _kick(rod, held, q, w, schur)
            continue
        # Make the energy convex along the supports.
        if descent > 0:
            # Near an equilibrium no more than needed, or what costs next to nothing to turn would
            # be turned slowly.
            used = 16 * used if used > 0 and shift == 0 else max(1e-4 * size, shift / 4)
            tries = 0
            while _system(rod, held, w, used, 0.0, schur) > 0 and tries < 20:
                used *= 4
                tries += 1
            shift = 0.0 if worst < NEAR else used
        for s in range(count + 3):
            total = -w.rest[s]
            if s < count:
                for i in range(n):
                    for a in range(3):
                        total += w.border[i, a, s] * w.solved[i, a, count]
            right[s, 0] = total
        if not _solve_border(schur, right):
            return STUCK, iteration, worst
        largest = 0.0
        for i in range(n):
            for a in range(3):
                t = -w.solved[i, a, count]
                for s in range(count):
                    t -= w.solved[i, a, s] * right[s, 0]
                turn[i, a] = t
            size = turn[i, 0] ** 2 + turn[i, 1] ** 2 + turn[i, 2] ** 2
            largest = max(largest, size)
        largest = math.sqrt(largest)
        if not math.isfinite(largest):
            return NOT_FINITE, iteration, worst
        curvature = _curvature(w, turn, used)
        for s in range(count):
            next_lam[s] = lam[s] + right[s, 0]
        share = 1.0 if largest < TURN_LIMIT else TURN_LIMIT / largest
        if largest < 1e-3 and used <= NEUTRAL * size:
            _step(held, q, lam, x0, turn, right, share)
            last_step = largest
            continue
        # Line search on the augmented Lagrangian at the new forces, in which L is quadratic.
        start, square = _at_forces(held, w, energy, right, gaps)
        tension = _tension(held, w, right)
        weight = 10 * tension / whole
        if square > 0 and curvature < 0.5 * weight * square:
            weight = max(weight, min(-4 * curvature / square, 1e4 * tension / whole))
        slope = -curvature - weight * square
        start += 0.5 * weight * square
        push = 0.0
        for end in range(2):
            i = 0 if end == 0 else n - 1
            for a in range(3):
                for b in range(3):
                    push += rod.moment[end, a] * w.frame[i, a, b] * turn[i, b]
        accepted = False
        noise = 1e-13 * (abs(start) + tension * whole)
        for _ in range(40):
            for i in range(n):
                _turn(q[i], turn[i], share, trial_q[i])
            for a in range(3):
                trial_x[a] = x0[a] + share * right[count + a, 0]
            value = _state(rod, held, trial_q, next_lam, trial_x, w) - share * push
            square = _conditions(rod, held, next_lam, w, gaps)
            value += 0.5 * weight * square
            if value <= start + 1e-4 * share * min(slope, 0.0) + noise:
                accepted = True
                break
            share *= 0.5
        if not accepted:
            if used > NEUTRAL * size and shift < 1e12:
                shift = 16 * used
                continue
            return STUCK, iteration, worst
        last_step = largest if share == 1.0 and used <= NEUTRAL * size else np.inf
        q[:], x0[:] = trial_q, trial_x
        for s in range(count):
            lam[s] += share * right[s, 0]
        if share == 1.0:  # the last state tried is the next one
            known, energy = True, value + share * push - 0.5 * weight * square
    return LIMIT, limit, worst


@helper
def _step(held, q, lam, x0, turn, right, share):
    """Move the state along a step."""
    count = held.node.shape[0]
    for i in range(q.shape[0]):
        _turn(q[i], turn[i], share, q[i])
    for s in range(count):
        lam[s] += share * right[s, 0]
    for a in range(3):
        if held.free:
            x0[a] += share * right[count + a, 0]


@helper
def _at_forces(held, w, energy, right, gaps):
    """L, and the square of the supports' conditions [m²], where only the forces have taken their
    step; energy: L before. `w` is of that state, its `rest` the conditions, `corner` L's second
    derivative."""
    count = held.node.shape[0]
    square = 0.0
    for s in range(count):
        gaps[s] = w.rest[s]
        if held.active[s]:
            for t in range(count):
                if held.active[t]:
                    gaps[s] += w.corner[s, t] * right[t, 0]
            energy += 0.5 * (w.rest[s] + gaps[s]) * right[s, 0]
            square += gaps[s] ** 2
    return energy, square


@helper
def _tension(held, w, right):
    """[N] the largest component of the force in the rope once the supports' forces have stepped."""
    count = held.node.shape[0]
    largest = 0.0
    for a in range(3):
        more = 0.0
        for i in range(w.force.shape[0] - 1, -1, -1):
            for s in range(count):
                if held.node[s] == i + 1 and held.active[s]:
                    more += right[s, 0] * held.direction[s, a]
            largest = max(largest, abs(w.force[i, a] + more))
    return largest


@helper
def _curvature(w, turn, shift):
    """δᵀ (A + shift) δ."""
    total = 0.0
    n = turn.shape[0]
    for i in range(n):
        for a in range(3):
            row = shift * turn[i, a]
            for b in range(3):
                row += w.diagonal[i, a, b] * turn[i, b]
                if i + 1 < n:
                    row += 2 * w.off[i, a, b] * turn[i + 1, b]
            total += turn[i, a] * row
    return total


@helper
def _kick(rod, held, q, w, schur):
    """Leave an unstable equilibrium along its steepest descent: inverse iteration on the Hessian,
    shifted just so far that it is convex."""
    n, count = rod.length.shape[0], held.node.shape[0]
    size = 0.0
    for i in range(n):
        for a in range(3):
            size = max(size, abs(w.diagonal[i, a, a]))
    mass = 1e-8 * size / rod.length[0]
    while _system(rod, held, w, 0.0, mass, schur) > 0 and mass < 1e6 * size / rod.length[0]:
        mass *= 2
    vector = np.empty((n, 3))
    for i in range(n):
        for a in range(3):
            vector[i, a] = math.sin(1.7 * i + 2.3 * a + 0.5)
    right = np.empty((count + 3, 1))
    for _ in range(12):
        for i in range(n):
            for a in range(3):
                w.border[i, a, count] = rod.length[i] * vector[i, a]
        _solve(w, count + 1, False)
        for s in range(count + 3):
            right[s, 0] = 0.0
            if s < count:
                for i in range(n):
                    for a in range(3):
                        right[s, 0] -= w.border[i, a, s] * w.solved[i, a, count]
        _solve_border(schur, right)
        largest = 0.0
        for i in range(n):
            for a in range(3):
                t = w.solved[i, a, count]
                for s in range(count):
                    t -= w.solved[i, a, s] * right[s, 0]
                vector[i, a] = t
                largest = max(largest, abs(t))
        vector /= largest
    for i in range(n):
        _turn(q[i], vector[i], 0.1, q[i])


# --- Derivatives of a solution -------------------------------------------------------------------


class Change(NamedTuple):
    """P directions in which a rope and its conditions change; the letters as in `Rod` and `Held`,
    clamp as a turn (2, 3) [rad] about the clamp's own axes, anchor (3,) [m] of node 0."""

    length: np.ndarray  # (P, N)
    supple: np.ndarray  # (P, N, 3)
    stiff: np.ndarray  # (P, N+1, 3)
    rest: np.ndarray  # (P, N+1, 3), vector part
    load: np.ndarray  # (P, N+1, 3)
    moment: np.ndarray  # (P, 2, 3)


@helper
def _turn_moments(p, dm, n, j, res, c):
    """Residual of the turns beside element j when its moment changes by dm."""
    h, x, y, z = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    c0, c1, c2 = y * dm[2] - z * dm[1], z * dm[0] - x * dm[2], x * dm[1] - y * dm[0]
    if j < n:
        res[j, 0, c] += h * dm[0] - c0
        res[j, 1, c] += h * dm[1] - c1
        res[j, 2, c] += h * dm[2] - c2
    if j > 0:
        res[j - 1, 0, c] += -h * dm[0] - c0
        res[j - 1, 1, c] += -h * dm[1] - c1
        res[j - 1, 2, c] += -h * dm[2] - c2


@helper
def _add_clamps(rod, held, w, turns, res, c):
    """Residual when the clamps turn by turns (2, 3)."""
    n = rod.length.shape[0]
    block = np.empty((3, 3))
    for end in range(2):
        j = 0 if end == 0 else n
        k = rod.stiff[j]
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        _cross(w, j, block)
        for a in range(3):
            for b in range(3):
                if end == 0:
                    res[0, a, c] += block[b, a] * turns[0, b]
                else:
                    res[n - 1, a, c] += block[a, b] * turns[1, b]


@helper
def _tangent_rope(rod, held, q, lam, x0, change, clamp, anchor, offset, w, schur, dx, turn):
    """First-order change of the nodes dx (P, N+1, 3) and of the frames turn (P, N, 3)."""
    n, count, many = rod.length.shape[0], held.node.shape[0], change.length.shape[0]
    _state(rod, held, q, lam, x0, w)
    _assemble(rod, held, lam, w)
    _corner(rod, held, w)
    b = w.border
    b[:, :, count:] = 0.0
    right = np.zeros((count + 3, many))
    dm = np.empty(3)
    for c in range(many):
        k = count + c
        for j in range(n + 1):
            for a in range(3):
                strain = w.p[j, a + 1] - rod.rest[j, a + 1]
                dm[a] = change.stiff[c, j, a] * strain - rod.stiff[j, a] * change.rest[c, j, a]
            _turn_moments(w.p[j], dm, n, j, b, k)
        _add_clamps(rod, held, w, clamp[c], b, k)
        f0, f1, f2 = 0.0, 0.0, 0.0
        for i in range(n - 1, -1, -1):
            f0 += change.load[c, i + 1, 0]
            f1 += change.load[c, i + 1, 1]
            f2 += change.load[c, i + 1, 2]
            r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
            v0 = r[0, 0] * f0 + r[1, 0] * f1 + r[2, 0] * f2
            v1 = r[0, 1] * f0 + r[1, 1] * f1 + r[2, 1] * f2
            v2 = r[0, 2] * f0 + r[1, 2] * f1 + r[2, 2] * f2
            e0, e1 = l * rod.supple[i, 0] * v0, l * rod.supple[i, 1] * v1
            e2 = l * rod.supple[i, 2] * v2
            dl = change.length[c, i] / l
            h0 = e0 + dl * g[0] + l * change.supple[c, i, 0] * u[0]
            h1 = e1 + dl * g[1] + l * change.supple[c, i, 1] * u[1]
            h2 = e2 + dl * g[2] + l * change.supple[c, i, 2] * u[2]
            b[i, 0, k] -= h1 * u[2] - h2 * u[1] + g[1] * v2 - g[2] * v1
            b[i, 1, k] -= h2 * u[0] - h0 * u[2] + g[2] * v0 - g[0] * v2
            b[i, 2, k] -= h0 * u[1] - h1 * u[0] + g[0] * v1 - g[1] * v0
            for a in range(3):
                dx[c, i + 1, a] = r[a, 0] * h0 + r[a, 1] * h1 + r[a, 2] * h2
        for end in range(2):
            i = 0 if end == 0 else n - 1
            r, m = w.frame[i], change.moment[c, end]
            for a in range(3):
                b[i, a, k] -= r[0, a] * m[0] + r[1, a] * m[1] + r[2, a] * m[2]
        for a in range(3):
            dx[c, 0, a] = 0.0 if held.free else anchor[c, a]
            for i in range(n):
                dx[c, i + 1, a] += dx[c, i, a]
            if held.free:
                for i in range(n + 1):
                    right[count + a, c] += change.load[c, i, a]
        for s in range(count):
            if held.active[s]:
                d, x = held.direction[s], dx[c, held.node[s]]
                right[s, c] = -(offset[c, s] - d[0] * x[0] - d[1] * x[1] - d[2] * x[2])
    _factor(w, 0.0, 0.0, rod.length)
    _solve(w, count + many, False)
    _schur(w, count, schur)
    for c in range(many):
        for s in range(count):
            for i in range(n):
                for a in range(3):
                    right[s, c] += b[i, a, s] * w.solved[i, a, count + c]
    if not _solve_border(schur, right):
        dx[:] = np.nan
        return
    for c in range(many):
        s0, s1, s2 = 0.0, 0.0, 0.0
        if held.free:
            s0, s1, s2 = right[count, c], right[count + 1, c], right[count + 2, c]
        for a in range(3):
            dx[c, 0, a] += (s0, s1, s2)[a]
        for i in range(n):
            r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
            f0, f1, f2 = 0.0, 0.0, 0.0
            t0, t1 = -w.solved[i, 0, count + c], -w.solved[i, 1, count + c]
            t2 = -w.solved[i, 2, count + c]
            for s in range(count):
                y = right[s, c]
                t0 -= w.solved[i, 0, s] * y
                t1 -= w.solved[i, 1, s] * y
                t2 -= w.solved[i, 2, s] * y
                if held.active[s] and held.node[s] > i:
                    f0 += y * held.direction[s, 0]
                    f1 += y * held.direction[s, 1]
                    f2 += y * held.direction[s, 2]
            turn[c, i, 0], turn[c, i, 1], turn[c, i, 2] = t0, t1, t2
            v0 = r[0, 0] * f0 + r[1, 0] * f1 + r[2, 0] * f2 + u[1] * t2 - u[2] * t1
            v1 = r[0, 1] * f0 + r[1, 1] * f1 + r[2, 1] * f2 + u[2] * t0 - u[0] * t2
            v2 = r[0, 2] * f0 + r[1, 2] * f1 + r[2, 2] * f2 + u[0] * t1 - u[1] * t0
            e0 = t1 * g[2] - t2 * g[1] + l * rod.supple[i, 0] * v0
            e1 = t2 * g[0] - t0 * g[2] + l * rod.supple[i, 1] * v1
            e2 = t0 * g[1] - t1 * g[0] + l * rod.supple[i, 2] * v2
            s0 += r[0, 0] * e0 + r[0, 1] * e1 + r[0, 2] * e2
            s1 += r[1, 0] * e0 + r[1, 1] * e1 + r[1, 2] * e2
            s2 += r[2, 0] * e0 + r[2, 1] * e1 + r[2, 2] * e2
            dx[c, i + 1, 0] += s0
            dx[c, i + 1, 1] += s1
            dx[c, i + 1, 2] += s2


class Pull(NamedTuple):
    """Gradients of a loss with respect to everything, one frame: letters as in `Change`."""

    length: np.ndarray
    supple: np.ndarray
    stiff: np.ndarray
    rest: np.ndarray
    load: np.ndarray
    moment: np.ndarray
    clamp: np.ndarray  # (2, 3) turns
    anchor: np.ndarray
    offset: np.ndarray
    direction: np.ndarray
    compliance: np.ndarray


@helper
def _adjoint_rope(rod, held, q, lam, x0, gx, gq, w, schur, out):
    """Gradient of a loss whose derivatives in the nodes and frames are gx (N+1, 3), gq (N, 4)."""
    n, count = rod.length.shape[0], held.node.shape[0]
    _state(rod, held, q, lam, x0, w)
    _assemble(rod, held, lam, w)
    _corner(rod, held, w)
    b = w.border
    right = np.zeros((count + 3, 1))
    suffix = np.zeros((n, 3))
    t0, t1, t2 = 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        t0 += gx[i + 1, 0]
        t1 += gx[i + 1, 1]
        t2 += gx[i + 1, 2]
        suffix[i, 0], suffix[i, 1], suffix[i, 2] = t0, t1, t2
        r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
        v0 = r[0, 0] * t0 + r[1, 0] * t1 + r[2, 0] * t2
        v1 = r[0, 1] * t0 + r[1, 1] * t1 + r[2, 1] * t2
        v2 = r[0, 2] * t0 + r[1, 2] * t1 + r[2, 2] * t2
        e0, e1 = l * rod.supple[i, 0] * v0, l * rod.supple[i, 1] * v1
        e2 = l * rod.supple[i, 2] * v2
        p, h = q[i], gq[i]
        b[i, 0, count] = (
            g[1] * v2
            - g[2] * v1
            - u[1] * e2
            + u[2] * e1
            + 0.5 * (-h[0] * p[1] + h[1] * p[0] + h[2] * p[3] - h[3] * p[2])
        )
        b[i, 1, count] = (
            g[2] * v0
            - g[0] * v2
            - u[2] * e0
            + u[0] * e2
            + 0.5 * (-h[0] * p[2] - h[1] * p[3] + h[2] * p[0] + h[3] * p[1])
        )
        b[i, 2, count] = (
            g[0] * v1
            - g[1] * v0
            - u[0] * e1
            + u[1] * e0
            + 0.5 * (-h[0] * p[3] + h[1] * p[2] - h[2] * p[1] + h[3] * p[0])
        )
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                d = held.direction[s]
                for a in range(3):
                    v = r[0, a] * d[0] + r[1, a] * d[1] + r[2, a] * d[2]
                    right[s, 0] += v * (e0, e1, e2)[a]
    total = (t0 + gx[0, 0], t1 + gx[0, 1], t2 + gx[0, 2])
    if held.free:
        for a in range(3):
            right[count + a, 0] = total[a]
    _factor(w, 0.0, 0.0, rod.length)
    _solve(w, count + 1, True)
    _schur(w, count, schur)
    for s in range(count):
        for i in range(n):
            for a in range(3):
                right[s, 0] -= b[i, a, s] * w.solved[i, a, count]
    if not _solve_border(schur, right):
        out.length[:] = np.nan
        return
    y = np.empty((n, 3))
    for i in range(n):
        for a in range(3):
            y[i, a] = w.solved[i, a, count]
            for s in range(count):
                y[i, a] -= w.solved[i, a, s] * right[s, 0]
    # Bend elements and clamps.
    block = np.empty((3, 3))
    for j in range(n + 1):
        p = w.p[j]
        k = rod.stiff[j]
        h, x1, x2, x3 = 0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
        for a in range(3):
            out.stiff[j, a], out.rest[j, a] = 0.0, 0.0
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        for side in range(2):
            i = j - 1 + side
            if i < 0 or i >= n:
                continue
            f = h if side == 1 else -h
            z0 = f * y[i, 0] + x2 * y[i, 2] - x3 * y[i, 1]
            z1 = f * y[i, 1] + x3 * y[i, 0] - x1 * y[i, 2]
            z2 = f * y[i, 2] + x1 * y[i, 1] - x2 * y[i, 0]
            for a in range(3):
                z = (z0, z1, z2)[a]
                out.stiff[j, a] -= (p[a + 1] - rod.rest[j, a + 1]) * z
                out.rest[j, a] += k[a] * z
    for end in range(2):
        j, i = (0, 0) if end == 0 else (n, n - 1)
        k = rod.stiff[j]
        held_turn = not (k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0)
        if held_turn:
            _cross(w, j, block)
        for a in range(3):
            out.clamp[end, a] = 0.0
            out.moment[end, a] = 0.0
            for c in range(3):
                if held_turn:
                    v = block[a, c] if end == 0 else block[c, a]
                    out.clamp[end, a] -= v * y[i, c]
                out.moment[end, a] += w.frame[i, a, c] * y[i, c]
    # Segments: with the supports' virtual moves added to the loss's derivative in the nodes.
    s0, s1, s2 = 0.0, 0.0, 0.0
    shift = np.zeros(3)
    if held.free:
        for a in range(3):
            shift[a] = right[count + a, 0]
    virtual = np.zeros((n, 3))
    for i in range(n):
        virtual[i] = suffix[i]
        for s in range(count):
            if held.active[s] and held.node[s] > i:
                for a in range(3):
                    virtual[i, a] += right[s, 0] * held.direction[s, a]
    for a in range(3):
        out.load[0, a] = shift[a]
    for i in range(n):
        r, u, g, l = w.frame[i], w.u[i], w.g[i], rod.length[i]
        v = virtual[i]
        c0 = u[1] * y[i, 2] - u[2] * y[i, 1]
        c1 = u[2] * y[i, 0] - u[0] * y[i, 2]
        c2 = u[0] * y[i, 1] - u[1] * y[i, 0]
        h0 = r[0, 0] * v[0] + r[1, 0] * v[1] + r[2, 0] * v[2] + c0
        h1 = r[0, 1] * v[0] + r[1, 1] * v[1] + r[2, 1] * v[2] + c1
        h2 = r[0, 2] * v[0] + r[1, 2] * v[1] + r[2, 2] * v[2] + c2
        out.supple[i, 0], out.supple[i, 1], out.supple[i, 2] = (
            l * u[0] * h0, l * u[1] * h1, l * u[2] * h2,
        )  # fmt: skip
        # g/l · (Rᵀ v) + y · (g/l x u) = g/l · (Rᵀ v + u x y)
        out.length[i] = (g[0] * h0 + g[1] * h1 + g[2] * h2) / l
        e0 = l * rod.supple[i, 0] * h0 + y[i, 1] * g[2] - y[i, 2] * g[1]
        e1 = l * rod.supple[i, 1] * h1 + y[i, 2] * g[0] - y[i, 0] * g[2]
        e2 = l * rod.supple[i, 2] * h2 + y[i, 0] * g[1] - y[i, 1] * g[0]
        s0 += r[0, 0] * e0 + r[0, 1] * e1 + r[0, 2] * e2
        s1 += r[1, 0] * e0 + r[1, 1] * e1 + r[1, 2] * e2
        s2 += r[2, 0] * e0 + r[2, 1] * e1 + r[2, 2] * e2
        out.load[i + 1, 0], out.load[i + 1, 1], out.load[i + 1, 2] = (
            s0 + shift[0], s1 + shift[1], s2 + shift[2],
        )  # fmt: skip
    for a in range(3):
        out.anchor[a] = 0.0 if held.free else total[a]
    for s in range(count):
        out.offset[s], out.compliance[s] = 0.0, 0.0
        for a in range(3):
            out.direction[s, a] = 0.0
        if held.active[s]:
            out.offset[s] = -right[s, 0]
            out.compliance[s] = lam[s] * right[s, 0]
            for a in range(3):
                if not held.free:
                    out.anchor[a] += right[s, 0] * held.direction[s, a]
                out.direction[s, a] = (
                    lam[s] * out.load[held.node[s], a] + right[s, 0] * w.x[held.node[s], a]
                )


@helper
def _smallest_eigenvalue(rod, held, q, lam, x0, w, schur):
    """Smallest eigenvalue [N] of the energy's second derivative in the turns, weighted by length,
    along the supports: by bisection on the number of descent directions."""
    n = rod.length.shape[0]
    _state(rod, held, q, lam, x0, w)
    _assemble(rod, held, lam, w)
    _corner(rod, held, w)
    high = 0.0
    for i in range(n):
        for a in range(3):
            high = max(high, abs(w.diagonal[i, a, a]) / rod.length[i])
    high *= 4
    if _system(rod, held, w, 0.0, 0.0, schur) > 0:
        low, sign = 1e-12 * high, -1.0
        while _system(rod, held, w, 0.0, low, schur) > 0 and low < 1e3 * high:
            low *= 4
        if low <= 1e-12 * high:
            return -low
        return -_bisect(rod, held, w, schur, low / 4, low, sign)
    low = high
    while _system(rod, held, w, 0.0, -low, schur) > 0 and low > 1e-14 * high:
        low /= 4
    if low >= high:
        return high
    return _bisect(rod, held, w, schur, low, 4 * low, 1.0)


@helper
def _bisect(rod, held, w, schur, low, high, sign):
    """The mass at which a direction of descent appears (sign 1) or is gone (sign -1)."""
    for _ in range(24):
        middle = math.sqrt(low * high)
        descends = _system(rod, held, w, 0.0, -sign * middle, schur) > 0
        if descends == (sign > 0):
            high = middle
        else:
            low = middle
        if high < low * (1 + 1e-6):
            break
    return math.sqrt(low * high)


# --- Entry points --------------------------------------------------------------------------------


class Rods(NamedTuple):
    """`Rod` for R ropes; `of` (F,) says which rope each frame shows."""

    length: np.ndarray
    supple: np.ndarray
    stiff: np.ndarray
    rest: np.ndarray
    load: np.ndarray
    moment: np.ndarray
    gauge: np.ndarray
    of: np.ndarray


class Frames(NamedTuple):
    """`Held` for F frames; node (S,) is common to all."""

    clamp: np.ndarray
    node: np.ndarray
    direction: np.ndarray
    offset: np.ndarray
    compliance: np.ndarray
    active: np.ndarray
    free: bool
    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray


@helper
def _rod(rods, t):
    k = rods.of[t]
    return Rod(
        rods.length[k], rods.supple[k], rods.stiff[k], rods.rest[k], rods.load[k],
        rods.moment[k], rods.gauge[k],
    )  # fmt: skip


@helper
def _held(frames, t):
    return Held(
        frames.clamp[t], frames.node, frames.direction[t], frames.offset[t],
        frames.compliance[t], frames.active[t], frames.free, frames.drag[t], frames.centre[t],
        frames.slip[t],
    )  # fmt: skip


@kernel
def solve_ropes(rods, frames, q, lam, x0, tolerance, limit, status, iterations, residual, x, force):
    """Equilibrium of F ropes from q (F, N, 4), lam (F, S), x0 (F, 3), which are changed in place.

    x (F, N+1, 3) [m], force (F, N, 3) [N], status, iterations, residual (F,) are written.
    """
    n, count = q.shape[1], lam.shape[1]
    w = make_work(n, count, 1)
    for t in range(q.shape[0]):
        rod, held = _rod(rods, t), _held(frames, t)
        status[t], iterations[t], residual[t] = _solve_rope(
            rod, held, q[t], lam[t], x0[t], tolerance, limit, w
        )
        _state(rod, held, q[t], lam[t], x0[t], w)
        x[t] = w.x
        force[t] = w.force


@kernel
def tangent_ropes(rods, frames, q, lam, x0, changes, clamp, anchor, offset, dx, turn):
    """Derivatives dx (F, P, N+1, 3), turn (F, P, N, 3) of solutions in P directions.

    changes: `Change` with arrays (R, P, ...); clamp (F, P, 2, 3), anchor (F, P, 3),
    offset (F, P, S).
    """
    n, count, many = q.shape[1], lam.shape[1], clamp.shape[1]
    w = make_work(n, count, many)
    schur = np.empty((count + 3, count + 3))
    for t in range(q.shape[0]):
        k = rods.of[t]
        change = Change(
            changes.length[k], changes.supple[k], changes.stiff[k], changes.rest[k],
            changes.load[k], changes.moment[k],
        )  # fmt: skip
        _tangent_rope(
            _rod(rods, t), _held(frames, t), q[t], lam[t], x0[t], change, clamp[t], anchor[t],
            offset[t], w, schur, dx[t], turn[t],
        )  # fmt: skip


@kernel
def adjoint_ropes(rods, frames, q, lam, x0, gx, gq, pulls):
    """Gradients of a loss with derivatives gx (F, N+1, 3), gq (F, N, 4) into `pulls` (F, ...)."""
    n, count = q.shape[1], lam.shape[1]
    w = make_work(n, count, 1)
    schur = np.empty((count + 3, count + 3))
    for t in range(q.shape[0]):
        out = Pull(
            pulls.length[t], pulls.supple[t], pulls.stiff[t], pulls.rest[t], pulls.load[t],
            pulls.moment[t], pulls.clamp[t], pulls.anchor[t], pulls.offset[t],
            pulls.direction[t], pulls.compliance[t],
        )  # fmt: skip
        _adjoint_rope(
            _rod(rods, t), _held(frames, t), q[t], lam[t], x0[t], gx[t], gq[t], w, schur, out
        )


@kernel
def stability_ropes(rods, frames, q, lam, x0, eigenvalue):
    """Smallest eigenvalue [N] of each rope's energy, see `_smallest_eigenvalue`."""
    n, count = q.shape[1], lam.shape[1]
    w = make_work(n, count, 1)
    schur = np.empty((count + 3, count + 3))
    for t in range(q.shape[0]):
        eigenvalue[t] = _smallest_eigenvalue(
            _rod(rods, t), _held(frames, t), q[t], lam[t], x0[t], w, schur
        )
