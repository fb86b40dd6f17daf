"""The two forms in quaternions that the strains are made of, and their gradients.

G(q) is the gradient of the third director, N(c) = Σ c_a B_a, antisymmetric, with the forms B of the
Darboux quaternion.
"""

from __future__ import annotations

from ropefit.solvers.kernels.jit import exact_helper


@exact_helper
def director_product(q, v):
    """Return G(q) v, 3 numbers; symmetric in q and v. The third director is G(q) q / 2."""
    return (
        2 * (q[2] * v[0] + q[3] * v[1] + q[0] * v[2] + q[1] * v[3]),
        2 * (-q[1] * v[0] - q[0] * v[1] + q[3] * v[2] + q[2] * v[3]),
        2 * (q[0] * v[0] - q[1] * v[1] - q[2] * v[2] + q[3] * v[3]),
    )


@exact_helper
def director_pull(c, q):
    """Return G(q)^T c, 4 numbers; a symmetric matrix times q."""
    return (
        2 * (c[0] * q[2] - c[1] * q[1] + c[2] * q[0]),
        2 * (c[0] * q[3] - c[1] * q[0] - c[2] * q[1]),
        2 * (c[0] * q[0] + c[1] * q[3] - c[2] * q[2]),
        2 * (c[0] * q[1] + c[1] * q[2] + c[2] * q[3]),
    )


@exact_helper
def imaginary(p, r):
    """Return Im(p* r), 3 numbers: p^T B_a r."""
    return (
        p[0] * r[1] - p[1] * r[0] - p[2] * r[3] + p[3] * r[2],
        p[0] * r[2] - p[2] * r[0] - p[3] * r[1] + p[1] * r[3],
        p[0] * r[3] - p[3] * r[0] - p[1] * r[2] + p[2] * r[1],
    )


@exact_helper
def darboux_pull(c, r):
    """Return N(c) r, 4 numbers: gradient of c · Im(p* r) with respect to p; -N(c) p is that for
    r."""
    return (
        c[0] * r[1] + c[1] * r[2] + c[2] * r[3],
        -c[0] * r[0] + c[1] * r[3] - c[2] * r[2],
        -c[0] * r[3] - c[1] * r[0] + c[2] * r[1],
        c[0] * r[2] - c[1] * r[1] - c[2] * r[0],
    )
