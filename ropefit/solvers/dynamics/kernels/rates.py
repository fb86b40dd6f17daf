"""Rates in time, and the strains and bends of a state whose rates they are."""

from __future__ import annotations

from ropefit.solvers.kernels.jit import helper
from ropefit.solvers.kernels.rotations import darboux, rotation


@helper
def step_ratio(time, t):
    """Return the length of the step to time t over that of the one before; zero for the first."""
    return 0.0 if t < 2 else (time[t] - time[t - 1]) / (time[t - 1] - time[t - 2])


@helper
def rates(time, t):
    """Return c0, c1, c2 of D at time t."""
    h = time[t] - time[t - 1]
    if t == 1:
        return 1.0 / h, -1.0 / h, 0.0
    w = step_ratio(time, t)
    return (1 + 2 * w) / ((1 + w) * h), -(1 + w) / h, w * w / ((1 + w) * h)


@helper
def jointed(stiffness, bend_viscosity, j):
    """Return whether there is a bend at node j: not at the ends of a rope that is not clamped."""
    return (
        stiffness[j, 0] != 0.0
        or stiffness[j, 1] != 0.0
        or stiffness[j, 2] != 0.0
        or bend_viscosity[j, 0] != 0.0
        or bend_viscosity[j, 1] != 0.0
        or bend_viscosity[j, 2] != 0.0
    )


@helper
def set_bends(rod, clamp, q, p):
    """Write the Darboux quaternions p (N+1, 4) of a state."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if jointed(rod.stiffness, rod.bend_viscosity, j):
            before = clamp[0] if j == 0 else q[j - 1]
            after = clamp[1] if j == n else q[j]
            darboux(before, after, rod.rest[j], p[j])


@helper
def set_strains(rod, x, q, r, out):
    """Write Γ (N, 3) of a state; r (3, 3) is scratch."""
    for i in range(rod.length.shape[0]):
        rotation(q[i], r)
        for a in range(3):
            out[i, a] = 0.0
            for b in range(3):
                out[i, a] += r[b, a] * (x[i + 1, b] - x[i, b]) / rod.length[i]
        out[i, 2] -= 1.0


@helper
def set_past(c1, c2, one, two, out):
    """Write c1 one + c2 two into out, row by row."""
    for k in range(out.shape[0]):
        for a in range(3):
            out[k, a] = c1 * one[k, a] + c2 * two[k, a]


@helper
def set_nodes_past(rate, one, two, out):
    """Do what `set_past` does, with coefficients of D for each row (K, 3)."""
    for k in range(out.shape[0]):
        for a in range(3):
            out[k, a] = rate[k, 1] * one[k, a] + rate[k, 2] * two[k, a]


@helper
def across(p, d, sign, out):
    """Add B d to out, the change of the Darboux vector by a turn d behind (sign 1) or before
    (-1)."""
    h, x, y, z = 0.5 * sign * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    out[0] += h * d[0] - z * d[1] + y * d[2]
    out[1] += z * d[0] + h * d[1] - x * d[2]
    out[2] += -y * d[0] + x * d[1] + h * d[2]


@helper
def across_back(p, m, sign, out):
    """Add Bᵀ m to out."""
    h, x, y, z = 0.5 * sign * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3]
    out[0] += h * m[0] + z * m[1] - y * m[2]
    out[1] += -z * m[0] + h * m[1] + x * m[2]
    out[2] += y * m[0] - x * m[1] + h * m[2]
