"""What one step has to solve: residual and matrix at a state, and a step already solved."""

from __future__ import annotations

from ropefit.solvers.dynamics.kernels.block_tridiagonal import factor
from ropefit.solvers.dynamics.kernels.contact import any_body, push_out, set_rates
from ropefit.solvers.dynamics.kernels.drag import set_resistance
from ropefit.solvers.dynamics.kernels.rates import (
    jointed,
    rates,
    set_bends,
    set_nodes_past,
    set_past,
    step_ratio,
)
from ropefit.solvers.kernels.bends import add_square, segment_block, set_cross, square_blocks
from ropefit.solvers.kernels.jit import helper, inlined
from ropefit.solvers.kernels.rotations import rotation


@helper
def prepare(rod, drive, t, c0, w):
    """Write what stays the same in the iterations of a step."""
    n = rod.length.shape[0]
    for k in range(n + 1):
        end, c = 0 if k == 0 else 1, w.rate[k, 0]
        if (k == 0 or k == n) and drive.held[end]:
            w.inverse_mass[k] = 0.0
            for a in range(3):
                w.y[k, a] = drive.ends[t, end, a]
            continue
        drag = rod.mass[k] * c + w.air[k]
        w.inverse_mass[k] = 1.0 / (drag * c + rod.spring[k])
        for a in range(3):
            known = rod.load[k, a] - drag * w.old_x[k, a] - rod.mass[k] * w.old_v[k, a]
            w.y[k, a] = w.inverse_mass[k] * known
    for j in range(n + 1):
        for a in range(3):
            w.firm[j, a] = rod.stiffness[j, a] + c0 * rod.bend_viscosity[j, a]


@helper
def assemble(rod, drive, t, c0, q, force, w):
    """Write the residual into `right`, the matrix into `pivot` (diagonal blocks) and `off`."""
    set_nodes(rod, force, w)
    _add_segments(rod, q, force, c0, w)
    set_bends(rod, drive.clamp[t], q, w.p)
    _add_bends(rod, c0, w)
    w.pivot[0, 2, 2] += rod.gauge


@inlined
def set_nodes(rod, force, w):
    """Write the nodes x (N+1, 3) that follow from the forces in the segments (N, 3)."""
    n = force.shape[0]
    for k in range(n + 1):
        for a in range(3):
            pull = 0.0
            if k < n:
                pull += force[k, a]
            if k > 0:
                pull -= force[k - 1, a]
            w.z[k, a] = w.x[k, a] = w.y[k, a] + w.inverse_mass[k] * pull
    if any_body(rod.bodies):
        push_out(rod, w)


@inlined
def _add_segments(rod, q, force, c0, w):
    """Begin residual and matrix with the segments' own."""
    for i in range(rod.length.shape[0]):
        r, l = w.frame[i], rod.length[i]
        rotation(q[i], r)
        for a in range(3):
            w.u[i, a] = r[0, a] * force[i, 0] + r[1, a] * force[i, 1] + r[2, a] * force[i, 2]
            share = rod.flexibility[i, a] / (
                1 + rod.flexibility[i, a] * rod.strain_viscosity[i, a] * c0
            )
            w.yields[i, a] = l * share
            w.g[i, a] = l * share * (w.u[i, a] - rod.strain_viscosity[i, a] * w.old_strain[i, a])
        w.g[i, 2] += l
        g, u, e = w.g[i], w.u[i], w.yields[i]
        b = w.right[i]
        b[0] = -(g[1] * u[2] - g[2] * u[1])
        b[1] = -(g[2] * u[0] - g[0] * u[2])
        b[2] = -(g[0] * u[1] - g[1] * u[0])
        h = w.pivot[i]
        h[:] = 0.0
        a00, a11, a22, a01, a02, a12 = segment_block(
            g[0], g[1], g[2], u[0], u[1], u[2], e[0], e[1], e[2]
        )
        h[0, 0], h[0, 1], h[0, 2] = a00, a01, a02
        h[1, 0], h[1, 1], h[1, 2] = a01, a11, a12
        h[2, 0], h[2, 1], h[2, 2] = a02, a12, a22
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
        if w.body[i] >= 0 or w.body[i + 1] >= 0:
            for k in range(i, i + 2):
                if w.body[k] >= 0:
                    for d in range(3):
                        for a in range(3):
                            h[3 + d, 3 + a] -= w.inverse_mass[k] * (w.out[k, d, a] - (a == d))
        w.off[i] = 0.0


@inlined
def _add_bends(rod, c0, w):
    """Add what the bend elements give."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if not jointed(rod.stiffness, rod.bend_viscosity, j):
            continue
        p, m, k = w.p[j], w.m[j], w.firm[j]
        for a in range(3):
            rate = c0 * p[a + 1] + w.old_p[j, a]
            m[a] = (
                rod.stiffness[j, a] * (p[a + 1] - rod.rest[j, a + 1])
                + rod.bend_viscosity[j, a] * rate
            )
        c_0 = 0.5 * (p[2] * m[2] - p[3] * m[1])
        c_1 = 0.5 * (p[3] * m[0] - p[1] * m[2])
        c_2 = 0.5 * (p[1] * m[1] - p[2] * m[0])
        h = 0.5 * p[0]
        bend = 0.25 * (m[0] * p[1] + m[1] * p[2] + m[2] * p[3])
        block = square_blocks(k[0], k[1], k[2], h, 0.5 * p[1], 0.5 * p[2], 0.5 * p[3], bend)
        if j < n:
            b = w.right[j]
            b[0] += h * m[0] - c_0
            b[1] += h * m[1] - c_1
            b[2] += h * m[2] - c_2
            add_square(w.pivot, j, block, 1.0)
        if j > 0:
            b = w.right[j - 1]
            b[0] += -h * m[0] - c_0
            b[1] += -h * m[1] - c_1
            b[2] += -h * m[2] - c_2
            add_square(w.pivot, j - 1, block, -1.0)
        if 0 < j < n:
            set_cross(p, m, k, w.off[j - 1])


@helper
def settled(rod, drive, t, qs, xs, forces, v, p, strain, half, w):
    """Return the factored system and work of the step that ended at time t, from histories of all
    times."""
    c0, c1, c2 = rates(drive.time, t)
    two = max(t - 2, 0)
    set_rates(rod, drive.time, xs, t, w.rate)
    set_nodes_past(w.rate, xs[t - 1], xs[two], w.old_x)
    set_nodes_past(w.rate, v[t - 1], v[two], w.old_v)
    set_past(c1, c2, p[t - 1, :, 1:], p[two, :, 1:], w.old_p)
    set_past(c1, c2, strain[t - 1], strain[two], w.old_strain)
    set_resistance(rod, step_ratio(drive.time, t), v[t - 1], v[two], w)
    prepare(rod, drive, t, c0, w)
    assemble(rod, drive, t, c0, qs[t], forces[t], w)
    factor(w, half)
