"""Second derivatives of a rope's energy in the turns of its segments: blocks of the Hessian.

Of a bend element, between two segments: p is its Darboux quaternion, m its moment, k its stiffness.
With v = (x, y, z) half the vector part of p and h half its real part, a turn of the segment behind
changes that vector part by B2 = h + [v]x, a turn of the one before by B1 = -h + [v]x.

Numbers in, numbers out: numba counts references to every view of an array that a loop makes, which
costs more than the arithmetic.
"""

from __future__ import annotations

from ropefit.solvers.kernels.jit import helper, inlined


@helper
def square_blocks(k0, k1, k2, h, x, y, z, bend):
    """Return B2ᵀ diag(k) B2 - bend: what it has in common with B1ᵀ diag(k) B1 - bend, and what is
    of the other sign there, each symmetric: 00, 11, 22, 01, 02, 12 and 01, 02, 12."""
    return (
        k0 * h * h + k1 * z * z + k2 * y * y - bend,
        k0 * z * z + k1 * h * h + k2 * x * x - bend,
        k0 * y * y + k1 * x * x + k2 * h * h - bend,
        -k2 * x * y,
        -k1 * x * z,
        -k0 * y * z,
        (k1 - k0) * h * z,
        (k0 - k2) * h * y,
        (k2 - k1) * h * x,
    )


@inlined
def add_square(diagonal, i, b, sign):
    """Add the blocks of `square_blocks` to diagonal[i]; sign: 1 behind the element, -1 before."""
    diagonal[i, 0, 0] += b[0]
    diagonal[i, 1, 1] += b[1]
    diagonal[i, 2, 2] += b[2]
    s01, s02, s12 = b[3] + sign * b[6], b[4] + sign * b[7], b[5] + sign * b[8]
    diagonal[i, 0, 1] += s01
    diagonal[i, 1, 0] += s01
    diagonal[i, 0, 2] += s02
    diagonal[i, 2, 0] += s02
    diagonal[i, 1, 2] += s12
    diagonal[i, 2, 1] += s12


@helper
def cross_block(p0, p1, p2, p3, m0, m1, m2, k0, k1, k2):
    """Return B1ᵀ diag(k) B2 - M/4 by rows, second derivative in the turns before and after."""
    h = 0.5 * p0
    x, y, z = 0.5 * p1, 0.5 * p2, 0.5 * p3
    # B = h + [v]x has rows (h, -z, y), (z, h, -x), (-y, x, h).
    mp = 0.25 * (m0 * p1 + m1 * p2 + m2 * p3)
    q0 = 0.25 * p0
    s01 = 0.25 * (p1 * m1 + m0 * p2) - k2 * y * x
    s02 = 0.25 * (p1 * m2 + m0 * p3) - k1 * z * x
    s12 = 0.25 * (p2 * m2 + m1 * p3) - k0 * z * y
    r01 = (k0 + k1) * h * z - q0 * m2
    r02 = (k0 + k2) * h * y - q0 * m1
    r12 = (k1 + k2) * h * x - q0 * m0
    return (
        -k0 * h * h + k1 * z * z + k2 * y * y - mp + 0.5 * p1 * m0, s01 + r01, s02 - r02,
        s01 - r01, k0 * z * z - k1 * h * h + k2 * x * x - mp + 0.5 * p2 * m1, s12 + r12,
        s02 + r02, s12 - r12, k0 * y * y + k1 * x * x - k2 * h * h - mp + 0.5 * p3 * m2,
    )  # fmt: skip


@helper
def set_cross(p, m, k, out):
    """Write `cross_block` of one element into out (3, 3)."""
    a = cross_block(p[0], p[1], p[2], p[3], m[0], m[1], m[2], k[0], k[1], k[2])
    out[0, 0], out[0, 1], out[0, 2] = a[0], a[1], a[2]
    out[1, 0], out[1, 1], out[1, 2] = a[3], a[4], a[5]
    out[2, 0], out[2, 1], out[2, 2] = a[6], a[7], a[8]


@helper
def segment_block(g0, g1, g2, u0, u1, u2, d0, d1, d2):
    """Return 00, 11, 22, 01, 02, 12 of the symmetric block of a segment's own turn: its edge g and
    its force u in its frame, and its flexibility times length d0, d1, d2 [m/N]."""
    return (
        g1 * u1 + g2 * u2 - (u2 * u2 * d1 + u1 * u1 * d2),
        g0 * u0 + g2 * u2 - (u2 * u2 * d0 + u0 * u0 * d2),
        g0 * u0 + g1 * u1 - (u1 * u1 * d0 + u0 * u0 * d1),
        -0.5 * (g0 * u1 + g1 * u0) + u0 * u1 * d2,
        -0.5 * (g0 * u2 + g2 * u0) + u0 * u2 * d1,
        -0.5 * (g1 * u2 + g2 * u1) + u1 * u2 * d0,
    )
