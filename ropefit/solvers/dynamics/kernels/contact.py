"""Fixed rigid bodies that the nodes touch, without friction: planes and round bars.

A node that a step without them would take to z, at a gap g(z) < 0 inside a body, is pushed out
straight: x = z - (1 - YIELD) g n, with n the slope of the gap. That is the implicit step against a
spring of stiffness (1/YIELD - 1) / W at a depth of YIELD |g|, W the node's compliance in this step.
Of several bodies a node is pushed out of the one that it would be deepest in.

An impact ends the past that a formula of two steps extrapolates from: with it a node would bounce,
and gain energy. For a node whose contact has changed in the last three steps, or is about to, rates
are of first order (backward Euler): it stays where it falls (Moreau 1988; Jean 1999).
"""

from __future__ import annotations

import math

from ropefit.rod.fields import NO_BODY, PLANE
from ropefit.solvers.dynamics.kernels.rates import rates, step_ratio
from ropefit.solvers.kernels.jit import helper, inlined

YIELD = 1e-3  # of the way that a step would go into a body, a node goes
PUSHED = 1 - YIELD
TINY = 1e-16  # m²: keeps the distance from a bar's axis smooth


@helper
def gap_of(body, x0, x1, x2):
    """Return the gap [m] of a body at a place, its slope (3), and the distance from its axis,
    infinite for a plane."""
    d0, d1, d2 = body[3], body[4], body[5]
    a0, a1, a2 = x0 - body[0], x1 - body[1], x2 - body[2]
    along = a0 * d0 + a1 * d1 + a2 * d2
    if body[7] == PLANE:
        return along, d0, d1, d2, math.inf
    a0, a1, a2 = a0 - along * d0, a1 - along * d1, a2 - along * d2
    far = math.sqrt(a0 * a0 + a1 * a1 + a2 * a2 + TINY)
    return far - body[6], a0 / far, a1 / far, a2 / far, far


@helper
def touched(bodies, x0, x1, x2):
    """Return which of the bodies (B, 8) a place is deepest in; -1: none."""
    found, deepest = -1, 0.0
    for b in range(bodies.shape[0]):
        if bodies[b, 7] != NO_BODY:
            gap = gap_of(bodies[b], x0, x1, x2)[0]
            if gap < deepest:
                found, deepest = b, gap
    return found


@helper
def any_body(bodies):
    """Return whether there is a body at all."""
    found = False
    for b in range(bodies.shape[0]):
        found |= bodies[b, 7] != NO_BODY
    return found


@helper
def set_rates(rod, time, xs, t, rate):
    """Write c0, c1, c2 of D at time t for each node (N+1, 3), from the nodes before it."""
    c0, c1, c2 = rates(time, t)
    for k in range(rate.shape[0]):
        rate[k, 0], rate[k, 1], rate[k, 2] = c0, c1, c2
    bodies, ratio = rod.bodies, step_ratio(time, t)
    if t == 1 or not any_body(bodies):
        return
    for k in range(rate.shape[0]):
        a, b, c = xs[t - 1, k], xs[t - 2, k], xs[max(t - 3, 0), k]
        now = touched(bodies, a[0], a[1], a[2])
        same = (
            touched(bodies, b[0], b[1], b[2]) == now
            and touched(bodies, c[0], c[1], c[2]) == now
            and now == touched(
                bodies, a[0] + ratio * (a[0] - b[0]), a[1] + ratio * (a[1] - b[1]),
                a[2] + ratio * (a[2] - b[2]),
            )
        )  # fmt: skip
        if not same:
            h = time[t] - time[t - 1]
            rate[k, 0], rate[k, 1], rate[k, 2] = 1.0 / h, -1.0 / h, 0.0


@inlined
def push_out(rod, w):
    """Push nodes x out of bodies, from z, where they would be without: write which body each
    touches, and dx/dz."""
    for k in range(w.z.shape[0]):
        z, x = w.z[k], w.x[k]
        w.body[k] = -1
        if w.inverse_mass[k] == 0.0:  # held
            continue
        which = touched(rod.bodies, z[0], z[1], z[2])
        if which < 0:
            continue
        w.body[k] = which
        body, out = rod.bodies[which], w.out[k]
        gap, n0, n1, n2, far = gap_of(body, z[0], z[1], z[2])
        n = (n0, n1, n2)
        bent = gap / far
        for a in range(3):
            x[a] -= PUSHED * gap * n[a]
            for c in range(3):
                across = (a == c) - body[3 + a] * body[3 + c] - n[a] * n[c]
                out[a, c] = (a == c) - PUSHED * (n[a] * n[c] + bent * across)


@inlined
def leave_bodies(rod, w, pulled, change):
    """Turn gradients in the nodes (N+1, 3) into those in the nodes without bodies, and add those in
    the bodies to change (B, 8)."""
    for k in range(pulled.shape[0]):
        if w.body[k] < 0:
            continue
        body, d, z, out = rod.bodies[w.body[k]], change[w.body[k]], w.z[k], w.out[k]
        gap, n0, n1, n2, far = gap_of(body, z[0], z[1], z[2])
        n, g = (n0, n1, n2), (pulled[k, 0], pulled[k, 1], pulled[k, 2])
        normal = g[0] * n0 + g[1] * n1 + g[2] * n2
        if body[7] == PLANE:
            for a in range(3):
                d[a] += PUSHED * normal * n[a]
                d[3 + a] -= PUSHED * (normal * (z[a] - body[a]) + gap * g[a])
        else:
            along, at = 0.0, 0.0
            for a in range(3):
                along += body[3 + a] * (z[a] - body[a])
                at += body[3 + a] * g[a] * gap / far
            for a in range(3):
                part = normal * n[a] + gap / far * (g[a] - normal * n[a])
                d[a] += PUSHED * (part - at * body[3 + a])
                d[3 + a] += PUSHED * (along * part + at * (z[a] - body[a]))
            d[6] += PUSHED * normal
        for a in range(3):  # dx/dz is symmetric
            pulled[k, a] = out[a, 0] * g[0] + out[a, 1] * g[1] + out[a, 2] * g[2]
