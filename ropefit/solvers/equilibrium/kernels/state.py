"""The state of one rope: forces, strains, nodes and moments, and how far the supports are off."""

from __future__ import annotations

import math

from ropefit.solvers.equilibrium.kernels.axial import set_stored, stretched
from ropefit.solvers.kernels.jit import helper, inlined
from ropefit.solvers.kernels.rotations import darboux, rotation


@helper
def set_state(rod, held, q, lam, x0, w):
    """Write forces, strains, nodes and moments of a state into the scratch; returns L [J]."""
    n = rod.length.shape[0]
    _set_forces(rod, held, lam, w)
    with_law = held.axial.shape[0] > 0
    if with_law:
        set_stored(held.axial, w.stored)
    total = 0.0
    for a in range(3):
        w.x[0, a] = x0[a]
    for i in range(n):
        r = w.frame[i]
        rotation(q[i], r)
        l = rod.length[i]
        for a in range(3):
            u = r[0, a] * w.force[i, 0] + r[1, a] * w.force[i, 1] + r[2, a] * w.force[i, 2]
            w.u[i, a] = u
            w.yields[i, a] = l * rod.flexibility[i, a]
            w.g[i, a] = w.yields[i, a] * u
            if a < 2 or not with_law:
                total -= 0.5 * w.yields[i, a] * u * u
        w.pull[i] = w.u[i, 2]
        if with_law:
            soft = w.yields[i, 2]
            w.pull[i], rate, energy = stretched(held.axial, w.stored, w.u[i, 2])
            w.g[i, 2], w.yields[i, 2] = soft * w.pull[i], soft * rate
            total -= soft * energy
        w.g[i, 2] += l
        total -= l * w.u[i, 2]
        for a in range(3):
            w.x[i + 1, a] = (
                w.x[i, a] + r[a, 0] * w.g[i, 0] + r[a, 1] * w.g[i, 1] + r[a, 2] * w.g[i, 2]
            )
    total = _set_bends(rod, held, q, w, total)
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


@inlined
def jointed(rod, j):
    """Return whether there is a bend at node j: not at the ends of a rope that is not clamped."""
    return rod.stiffness[j, 0] != 0.0 or rod.stiffness[j, 1] != 0.0 or rod.stiffness[j, 2] != 0.0


@inlined
def _set_forces(rod, held, lam, w):
    """Write the force in each segment, summed from the far end."""
    f0, f1, f2 = 0.0, 0.0, 0.0
    for i in range(rod.length.shape[0] - 1, -1, -1):
        f0 += rod.load[i + 1, 0]
        f1 += rod.load[i + 1, 1]
        f2 += rod.load[i + 1, 2]
        for s in range(held.node.shape[0]):
            if held.node[s] == i + 1 and held.active[s]:
                f0 += lam[s] * held.direction[s, 0]
                f1 += lam[s] * held.direction[s, 1]
                f2 += lam[s] * held.direction[s, 2]
        w.force[i, 0], w.force[i, 1], w.force[i, 2] = f0, f1, f2


@inlined
def _set_bends(rod, held, q, w, total):
    """Write Darboux quaternions, moments and stiffnesses; returns total plus their energy [J]."""
    n = rod.length.shape[0]
    for j in range(n + 1):
        if not jointed(rod, j):
            w.m[j, 0], w.m[j, 1], w.m[j, 2] = 0.0, 0.0, 0.0
            continue
        before = held.clamp[0] if j == 0 else q[j - 1]
        after = held.clamp[1] if j == n else q[j]
        darboux(before, after, rod.rest[j], w.p[j])
        for a in range(3):
            c = w.p[j, a + 1] - rod.rest[j, a + 1]
            k = rod.stiffness[j, a]
            w.m[j, a], w.k[j, a] = k * c, k
            total += 0.5 * k * c * c
        if held.drag.shape[0] > 0:
            w.coupling[j] = 0.0
            for b in range(held.drag.shape[0]):
                if held.gradual[b]:
                    total += _add_gradual(held, b, j, w)
                else:
                    total += _add_friction(held, b, j, w)
    return total


@helper
def _add_friction(held, b, j, w):
    """Add moment and stiffness of friction element b to bend element j; returns its energy [J].

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
def _add_gradual(held, b, j, w):
    """Add moment and stiffness of friction element b, of those that build up gradually, to bend
    element j; returns its energy [J]. The closed form is that of `rod.dahl`."""
    k, reach = held.drag[b, j], held.slip[b, j]
    e0, e1 = held.strain[b, j, 0], held.strain[b, j, 1]
    d0, d1 = w.p[j, 1] - held.centre[b, j, 0], w.p[j, 2] - held.centre[b, j, 1]
    size = math.sqrt(d0 * d0 + d1 * d1)
    x = size / reach
    if x < 1e-12:  # stiffness that is the mean of both senses of every direction
        w.m[j, 0] += k * (e0 + d0)
        w.m[j, 1] += k * (e1 + d1)
        w.k[j, 0] += k
        w.k[j, 1] += k
        return k * (e0 * d0 + e1 * d1 + 0.5 * size * size)
    n0, n1 = d0 / size, d1 / size
    along, across = e0 * n0 + e1 * n1, e1 * n0 - e0 * n1
    gone = -math.expm1(-x)
    left, share = 1.0 - gone, gone / x
    # (left - share) / x: its series where the difference would be lost.
    bend = -0.5 + x / 3.0 - x * x / 8.0 if x < 1e-3 else (left - share) / x
    f, g = reach * gone + left * along, share * across
    w.m[j, 0] += k * (f * n0 - g * n1)
    w.m[j, 1] += k * (f * n1 + g * n0)
    radial = left * (1.0 - along / reach)
    mixed = bend * across / reach
    round_ = share + bend * along / reach
    w.k[j, 0] += k * (radial * n0 * n0 - 2.0 * mixed * n0 * n1 + round_ * n1 * n1)
    w.k[j, 1] += k * (radial * n1 * n1 + 2.0 * mixed * n0 * n1 + round_ * n0 * n0)
    w.coupling[j] += k * ((radial - round_) * n0 * n1 + mixed * (n0 * n0 - n1 * n1))
    return k * reach * (reach * (x - gone) + gone * along)


@helper
def violations(rod, held, lam, w, out):
    """Write the derivative of L in λ and x_0 into out; return its square in the supports [m²]."""
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
