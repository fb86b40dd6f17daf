"""What the line search of a Newton step compares: the augmented Lagrangian and its slope."""

from __future__ import annotations

from ropefit.solvers.kernels.jit import helper, inlined


@inlined
def merit(held, energy, curvature, whole, w):
    """Return what the line search compares with: the augmented Lagrangian at the new forces (in
    which L is quadratic), its slope along the step, its penalty's weight [N/m], and rounding."""
    start, square = _at_forces(held, w, energy)
    tension = _tension(held, w)
    weight = 10 * tension / whole
    if square > 0 and curvature < 0.5 * weight * square:
        weight = max(weight, min(-4 * curvature / square, 1e4 * tension / whole))
    slope = -curvature - weight * square
    start += 0.5 * weight * square
    return start, slope, weight, 1e-13 * (abs(start) + tension * whole)


@helper
def _at_forces(held, w, energy):
    """Return L, and the square of the supports' conditions [m²], where only the forces have taken
    their step; energy: L before. `w` is of that state, its `rest` the conditions, `corner` L's
    second derivative."""
    count = held.node.shape[0]
    square = 0.0
    for s in range(count):
        w.gaps[s] = w.rest[s]
        if held.active[s]:
            for t in range(count):
                if held.active[t]:
                    w.gaps[s] += w.corner[s, t] * w.right[t, 0]
            energy += 0.5 * (w.rest[s] + w.gaps[s]) * w.right[s, 0]
            square += w.gaps[s] ** 2
    return energy, square


@helper
def _tension(held, w):
    """Return [N] the largest component of the force in the rope once the supports' forces have
    stepped."""
    count = held.node.shape[0]
    largest = 0.0
    for a in range(3):
        more = 0.0
        for i in range(w.force.shape[0] - 1, -1, -1):
            for s in range(count):
                if held.node[s] == i + 1 and held.active[s]:
                    more += w.right[s, 0] * held.direction[s, a]
            largest = max(largest, abs(w.force[i, a] + more))
    return largest


@inlined
def end_work(rod, w):
    """Return the work [J] of the moments given at the ends along a whole step."""
    push = 0.0
    for end in range(2):
        i = 0 if end == 0 else w.turn.shape[0] - 1
        for a in range(3):
            for b in range(3):
                push += rod.moment[end, a] * w.frame[i, a, b] * w.turn[i, b]
    return push


@helper
def curvature_along(w, shift):
    """Return δᵀ (A + shift) δ."""
    total = 0.0
    n = w.turn.shape[0]
    for i in range(n):
        for a in range(3):
            row = shift * w.turn[i, a]
            for b in range(3):
                row += w.diagonal[i, a, b] * w.turn[i, b]
                if i + 1 < n:
                    row += 2 * w.off[i, a, b] * w.turn[i + 1, b]
            total += w.turn[i, a] * row
    return total
