"""Second derivatives of a rope's energy in the turns of its segments: blocks of the Hessian.

Of a bend element, between two segments: p is its Darboux quaternion, m its moment, k its stiffness.
With v half the vector part of p and h half its real part, a turn of the segment behind changes that
vector part by B2 = h + [v]x, a turn of the one before by B1 = -h + [v]x.
"""

from __future__ import annotations

from ropefit.solvers.kernels.jit import helper, inlined


@inlined
def add_square(a, k, h, x, y, z, bend):
    """Add Bᵀ diag(k) B - bend to a, with B = h + [v]x."""
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
def cross_block(p, m, k, out):
    """Write B1ᵀ diag(k) B2 - M/4 into out (3, 3), second derivative in the turns before and
    after."""
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


@inlined
def segment_block(g, u, d0, d1, d2, out):
    """Write the block (3, 3) of a segment's own turn: its edge g and its force u in its frame, and
    its flexibility times length d0, d1, d2 [m/N]."""
    gu = g[0] * u[0] + g[1] * u[1] + g[2] * u[2]
    out[0, 0] = gu - g[0] * u[0] - (u[2] * u[2] * d1 + u[1] * u[1] * d2)
    out[1, 1] = gu - g[1] * u[1] - (u[2] * u[2] * d0 + u[0] * u[0] * d2)
    out[2, 2] = gu - g[2] * u[2] - (u[1] * u[1] * d0 + u[0] * u[0] * d1)
    out[0, 1] = -0.5 * (g[0] * u[1] + g[1] * u[0]) + u[0] * u[1] * d2
    out[0, 2] = -0.5 * (g[0] * u[2] + g[2] * u[0]) + u[0] * u[2] * d1
    out[1, 2] = -0.5 * (g[1] * u[2] + g[2] * u[1]) + u[1] * u[2] * d0
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]
