"""The planar rod under its own weight, solved as a boundary-value problem by scipy.

In the plane of x and z with gravity along -z; the tangent is (cos θ, sin θ), s runs from end 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

Array = NDArray[np.float64]
Along = Callable[[Array], Array]  # a function of arc lengths (n,) [m]
STEPS = 40  # of the continuation in EI
FIRST_EI_HELD, FIRST_EI_FREE = 0.1, 10.0  # over weight times length², where it begins


class Guess(NamedTuple):
    """Initial guess of `elastica`: arc (n,) [m], angle (n,) [rad], x and z (n,) [m], force (2,) [N]
    in the rope at end 0."""

    arc: Array
    angle: Array
    x: Array
    z: Array
    force: Array


@dataclass(frozen=True)
class Planar:
    """A rope in a plane: length [m], bend EI [N m²], weight [N/m], axial EA and shear GA [N],
    curvature [1/m] of the rest shape.

    End 0 is at the origin, `far` (x, z) [m] is where end 1 is held, None if free: then `force` (x,
    z) [N] pulls on it. first, last: angles [rad] of clamps; without, the end turns freely and
    `moment` [N m] turns end 1. Along the rope EI may vary by `factor` (of s [m], dimensionless)
    and the rest curvature by `bent` [1/m].
    """

    length: float
    bend: float
    weight: float
    axial: float = math.inf
    shear: float = math.inf
    curvature: float = 0.0
    far: tuple[float, float] | None = None
    first: float | None = None
    last: float | None = None
    force: tuple[float, float] = (0.0, 0.0)
    moment: float = 0.0
    factor: Along = np.ones_like
    bent: Along = np.zeros_like


def elastica(rope: Planar, guess: Guess, arc: Array) -> tuple[Array, Array]:
    """Return positions (n, 2) [m] and angles (n,) [rad] at arc lengths (n,) of a heavy elastica.

    Raises RuntimeError where the collocation does not converge from the guess.
    """
    bent = np.gradient(guess.angle, guess.arc) - rope.curvature - rope.bent(guess.arc)
    kappa = bent * rope.factor(guess.arc)
    start = np.stack([guess.angle, kappa, guess.x, guess.z])
    y = _solve(rope, guess.arc, start, guess.force).sol(arc)
    return y[2:].T, y[0]


def from_stiffer_ropes(rope: Planar, arc: Array) -> Array:
    """Return positions (n, 2) [m] at arc lengths (n,) by continuation from a stiff rope.

    End 0 is pinned below a held end 1, or clamped at angle 0 with a free end 1. Raises RuntimeError
    as `elastica`.
    """
    s = np.linspace(0, rope.length, 201)
    y, force = _stiff_guess(rope, s)
    unit = rope.weight * rope.length**3
    stiffest = unit * (FIRST_EI_FREE if rope.far is None else FIRST_EI_HELD)
    found = None
    for bend in np.geomspace(max(rope.bend, stiffest), rope.bend, STEPS):
        found = _solve(replace(rope, bend=float(bend)), s, y, force)
        # The mesh follows the solution, so the guess needs no interpolation.
        s, y, force = found.x, found.y, found.p
    assert found is not None
    return found.sol(arc)[2:].T


def _stiff_guess(rope: Planar, s: Array) -> tuple[Array, Array]:
    """Return states (4, n) and the force (2,) [N] at end 0 near those of a stiff rope."""
    y = np.zeros((4, s.size))
    y[2] = s
    if rope.far is None:
        return y, np.array([0.0, -rope.weight * rope.length])
    share, (span, drop) = s / rope.length, rope.far
    # A parabola that sags as the rope does is near enough for the first, stiffest rope.
    sag = np.sqrt(3 * span * (rope.length - np.hypot(span, drop)) / 8)
    y[2] = span * share
    y[3] = drop * share - 4 * sag * share * (1 - share)
    y[0] = np.arctan2(np.gradient(y[3]), np.gradient(y[2]))
    y[1] = np.gradient(y[0], s)
    return y, np.array([0.3, -0.5]) * rope.weight * rope.length


def _solve(rope: Planar, mesh: Array, start: Array, force: Array) -> Any:
    """Return scipy's solution: θ, κ, x, z along the rope and the force at end 0.

    The balance of a planar rod (Antman, Nonlinear Problems of Elasticity, chapter 4), with the
    moment EI κ: θ' = κ / factor + κ0, EI κ' = -(r' x n), n = (H, V + w s), r' from the strains n/EA
    and n/GA. Collocation to a relative residual of 1e-8.
    """

    def slope(s: Array, y: Array, p: Array) -> Array:
        angle = y[0]
        c, d = np.cos(angle), np.sin(angle)
        across, up = p[0], p[1] + rope.weight * s
        along = 1 + (c * across + d * up) / rope.axial
        sheared = (c * up - d * across) / rope.shear
        dx, dz = c * along - d * sheared, d * along + c * sheared
        turning = (dz * across - dx * up) / rope.bend
        return np.stack([y[1] / rope.factor(s) + rope.curvature + rope.bent(s), turning, dx, dz])

    def ends(a: Array, b: Array, p: Array) -> Array:
        if rope.far is None:
            held = [p[0] - rope.force[0], p[1] + rope.weight * rope.length - rope.force[1]]
        else:
            held = [b[2] - rope.far[0], b[3] - rope.far[1]]
        first = a[1] if rope.first is None else a[0] - rope.first
        last = rope.bend * b[1] - rope.moment if rope.last is None else b[0] - rope.last
        return np.array([a[2], a[3], first, last, *held])

    found = solve_bvp(slope, ends, mesh, start, p=force, tol=1e-8, bc_tol=1e-10, max_nodes=50000)
    if not found.success:
        raise RuntimeError(f"no reference solution at EI = {rope.bend:g} N m²: {found.message}")
    return found
