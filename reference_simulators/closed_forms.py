"""Closed-form solutions of ropes in equilibrium.

Planar ones lie in the plane of x and z with gravity along -z; s runs from end 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    return float(brentq(function, low, high, xtol=1e-14))  # type: ignore[arg-type]


def catenary(length: float, far: tuple[float, float], arc: np.ndarray, stretch: float = 0.0):
    """Return (n, 2) [m]: a rope without stiffness between (0, 0) and `far`.

    Stretch is its weight over EA.

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
    """Return the depth (n,) [m] below end 0 of a rope that hangs straight down.

    S + w (L s - s²/2) / EA.
    """
    return arc + weight * (length * arc - 0.5 * arc**2) / axial


def buckled_reach(load: float, critical: float) -> float:
    """Return the distance of the ends over the length of a pinned strut under a supercritical load.

    2 E(k)/K(k) - 1 with load/critical = (2 K(k)/π)² (Timoshenko & Gere, section 2.7).
    """
    m = _root(lambda m: (2 * ellipk(m) / np.pi) ** 2 - load / critical, 0.0, 0.999)
    return 2 * ellipe(m) / ellipk(m) - 1


def helix(curvature: float, twist: float, arc: np.ndarray) -> np.ndarray:
    """Return the centreline (n, 3) [m] of constant curvature about the first director and twist.

    From the origin with directors along the axes, both [1/m]: Rodrigues' rotation about a fixed
    axis, integrated.
    """
    axis = np.array([curvature, 0.0, twist])
    rate = np.linalg.norm(axis)
    axis = axis / rate
    e3 = np.array([0.0, 0.0, 1.0])
    across, along = np.cross(axis, e3), axis * axis[2]
    s = arc[:, None]
    return (
        along * s + (e3 - along) * np.sin(rate * s) / rate + across * (1 - np.cos(rate * s)) / rate
    )
