"""Known answers for ropes in equilibrium: closed forms, and boundary-value solutions by scipy.

All in the plane of x and z with gravity along -z; the tangent is (cos θ, sin θ), s runs from end 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk


class Guess(NamedTuple):
    """Where `elastica` starts: arc (n,) [m], angle (n,) [rad], x and z (n,) [m], force (2,) [N] in
    the rope at end 0."""

    arc: np.ndarray
    angle: np.ndarray
    x: np.ndarray
    z: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class Planar:
    """A rope in a plane: length [m], bend EI [N m²], weight [N/m], axial EA and shear GA [N],
    curvature [1/m] of the rest shape.

    End 0 is at the origin, `far` (x, z) [m] is where end 1 is held, None if free: then `force` (x,
    z) [N] pulls on it. first, last: angles [rad] of clamps; without, the end turns freely and
    `moment` [N m] turns end 1.
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


def elastica(rope: Planar, guess: Guess, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2) [m] and angles (n,) [rad] at arc lengths (n,) of a heavy elastica.

    The balance of a planar rod (Antman, Nonlinear Problems of Elasticity, chapter 4): θ' = κ + κ0,
    (EI κ)' = -(r' x n), n = (H, V + w s), with r' from the strains n/EA and n/GA. scipy's
    collocation to a relative residual of 1e-8. Raises RuntimeError when that fails.
    """

    def slope(s: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        angle, bent = y[0], y[1]
        c, d = np.cos(angle), np.sin(angle)
        across, up = p[0], p[1] + rope.weight * s
        along = 1 + (c * across + d * up) / rope.axial
        sheared = (c * up - d * across) / rope.shear
        dx, dz = c * along - d * sheared, d * along + c * sheared
        turning = (dz * across - dx * up) / rope.bend
        return np.stack([bent + rope.curvature, turning, dx, dz])

    def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        if rope.far is None:
            held = [p[0] - rope.force[0], p[1] + rope.weight * rope.length - rope.force[1]]
        else:
            held = [b[2] - rope.far[0], b[3] - rope.far[1]]
        first = a[1] if rope.first is None else a[0] - rope.first
        last = rope.bend * b[1] - rope.moment if rope.last is None else b[0] - rope.last
        return np.array([a[2], a[3], first, last, *held])

    bent = np.gradient(guess.angle, guess.arc) - rope.curvature
    start = np.stack([guess.angle, bent, guess.x, guess.z])
    found = solve_bvp(
        slope, ends, guess.arc, start, p=guess.force, tol=1e-8, bc_tol=1e-10, max_nodes=50000
    )
    if not found.success:
        raise RuntimeError(f"no reference solution: {found.message}")
    y = found.sol(arc)
    return y[2:].T, y[0]


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-14))  # type: ignore[arg-type]


def catenary(length: float, far: tuple[float, float], arc: np.ndarray, stretch: float = 0.0):
    """(n, 2) [m] a rope without stiffness between (0, 0) and `far`; stretch is its weight over EA.

    The elastic catenary (Irvine, Cable Structures, section 1.4): in units of the weight,
    x = H (asinh((s-c)/H) + asinh(c/H)) + stretch H s/L, z likewise.
    """

    def at(h: float, lowest: float, s: np.ndarray | float):
        flat = h * (np.arcsinh((s - lowest) / h) + np.arcsinh(lowest / h))
        up = np.hypot(h, s - lowest) - np.hypot(h, lowest)
        soft = stretch / length
        return flat + soft * h * s, up + soft * (0.5 * np.square(s) - lowest * s)

    def lowest_of(h: float) -> float:
        return _root(lambda c: at(h, c, length)[1] - far[1], -50 * length, 50 * length)

    h = _root(
        lambda log: at(math.exp(log), lowest_of(math.exp(log)), length)[0] - far[0],
        math.log(1e-4 * length), math.log(1e2 * length),
    )  # fmt: skip
    return np.stack(at(math.exp(h), lowest_of(math.exp(h)), arc), axis=-1)


def hanging_bar(weight: float, axial: float, length: float, arc: np.ndarray) -> np.ndarray:
    """(n,) [m] depth below end 0 of a rope that hangs straight down: s + w (L s - s²/2) / EA."""
    return arc + weight * (length * arc - 0.5 * arc**2) / axial


def buckled_reach(load: float, critical: float) -> float:
    """Distance of the ends over the length of a pinned strut under `load` beyond the critical one:
    2 E(k)/K(k) - 1 with load/critical = (2 K(k)/π)² (Timoshenko & Gere, section 2.7)."""
    m = _root(lambda m: (2 * ellipk(m) / np.pi) ** 2 - load / critical, 0.0, 0.999)
    return 2 * ellipe(m) / ellipk(m) - 1


def helix(curvature: float, twist: float, arc: np.ndarray) -> np.ndarray:
    """(n, 3) [m] centreline of constant curvature about the first director and constant twist
    [1/m], from the origin with directors along the axes: Rodrigues' rotation about a fixed axis,
    integrated."""
    axis = np.array([curvature, 0.0, twist])
    rate = np.linalg.norm(axis)
    axis = axis / rate
    e3 = np.array([0.0, 0.0, 1.0])
    across, along = np.cross(axis, e3), axis * axis[2]
    s = arc[:, None]
    return (
        along * s + (e3 - along) * np.sin(rate * s) / rate + across * (1 - np.cos(rate * s)) / rate
    )
