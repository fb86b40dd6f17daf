"""Rotations as quaternions q (w, x, y, z) in compiled loops."""

from __future__ import annotations

import math

from ropefit.solvers.kernels.jit import exact_helper, helper, inlined


@helper
def rotation(q, r):
    """Write R(q) into r (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@helper
def turn_by(q, d, share, out):
    """Write q exp(share d / 2), normalised, into out."""
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


@inlined
def darboux(a, b, rest, p):
    """Write p = a* b, of the sign that lies nearer to the rest rotation."""
    p0 = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    p1 = a[0] * b[1] - b[0] * a[1] - (a[2] * b[3] - a[3] * b[2])
    p2 = a[0] * b[2] - b[0] * a[2] - (a[3] * b[1] - a[1] * b[3])
    p3 = a[0] * b[3] - b[0] * a[3] - (a[1] * b[2] - a[2] * b[1])
    s = 1.0
    if p0 * rest[0] + p1 * rest[1] + p2 * rest[2] + p3 * rest[3] < 0:
        s = -1.0
    p[0], p[1], p[2], p[3] = s * p0, s * p1, s * p2, s * p3


@exact_helper
def perpendicular(v, out):
    """Write v x e into out, e the axis that v (3,) is least along."""
    k = 0
    for a in range(1, 3):
        if abs(v[a]) < abs(v[k]):
            k = a
    i, j = (k + 1) % 3, (k + 2) % 3
    out[k], out[i], out[j] = 0.0, v[j], -v[i]


@exact_helper
def smallest_turn(a, b, out):
    """Write the quaternion of least angle that turns the unit vector a into b."""
    real = 1 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if real < 1e-12:  # a half turn: any axis across a
        real = 0.0
        perpendicular(a, out[1:])
    else:
        out[1] = a[1] * b[2] - a[2] * b[1]
        out[2] = a[2] * b[0] - a[0] * b[2]
        out[3] = a[0] * b[1] - a[1] * b[0]
    out[0] = real
    size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    for k in range(4):
        out[k] /= size


@exact_helper
def product(p, q, out):
    """Write p q into out, which may be one of them."""
    w = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    x = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    z = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    out[0], out[1], out[2], out[3] = w, x, y, z


@exact_helper
def director(q, out):
    """Write the third director of the frame q, its tangent, into out."""
    out[0] = 2 * (q[1] * q[3] + q[0] * q[2])
    out[1] = 2 * (q[2] * q[3] - q[0] * q[1])
    out[2] = 1 - 2 * (q[1] * q[1] + q[2] * q[2])
