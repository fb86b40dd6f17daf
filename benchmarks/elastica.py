"""The planar elastica under its own weight, solved as a boundary-value problem: no ropefit in it.

theta' = M / EI + kappa0, M' = Nx sin(theta) - Nz cos(theta), with the force Nx constant and
Nz' = w, the weight per length; gravity acts along -z, theta is counted from x towards z. Lengths in
units of the rope's, forces of its weight.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from ropefit.exporters import RopeDescription
from ropefit.exporters.rotation import from_vector

LENGTH, MASS, G = 1.0, 0.05, 9.81
SPAN, DROP = 0.6, 0.1  # m, of the pinned ends
Along = Callable[[np.ndarray], np.ndarray]


def elastica(
    ends: str,
    ratio: float,
    s: np.ndarray,
    stiffness: Along = np.ones_like,
    curvature: Along = np.zeros_like,
    tip: float = 0.0,
) -> np.ndarray:
    """(K, 3) [m] centreline at arc lengths s of a rope 1 m long; ratio = EI / (w L^3).

    ends: "pinned" hangs between the origin and (SPAN, 0, DROP); "clamped" leaves the origin
    horizontally and ends freely. stiffness(s): EI over the EI of `ratio`. curvature(s): rest
    curvature [1/m] towards +z. tip: a mass hung on a free end, in rope masses.
    """
    clamped = ends == "clamped"
    mesh = np.linspace(0, 1, 201)
    y, forces = _first_guess(mesh, clamped)
    # From a stiff rope to the wanted one; the clamped one starts almost straight.
    for step in np.geomspace(max(ratio, 10.0 if clamped else 0.1), ratio, 40):

        def slope(at: np.ndarray, y: np.ndarray, p: np.ndarray = forces, step: float = step):
            nx, nz = (0.0, at - 1 - tip) if clamped else (p[0], p[1] + at)
            bend = y[3] / (step * stiffness(at)) + curvature(at)
            turn = nx * np.sin(y[2]) - nz * np.cos(y[2])
            return np.stack([np.cos(y[2]), np.sin(y[2]), bend, turn])

        def held(a: np.ndarray, b: np.ndarray, p: np.ndarray = forces):
            if clamped:
                return np.array([a[0], a[1], a[2], b[3]])
            return np.array([a[0], a[1], a[3], b[0] - SPAN, b[1] - DROP, b[3]])

        # The mesh follows the solution, so the solver's slopes need no memory of the last step.
        unknown = None if clamped else forces
        found = solve_bvp(slope, held, mesh, y, p=unknown, tol=1e-7, max_nodes=100_000)
        if not found.success:
            raise RuntimeError(f"elastica {ends} at {step:g}: {found.message}")
        mesh, y = found.x, found.y
        forces = forces if clamped else found.p
    at = found.sol(s)
    return np.stack([at[0], np.zeros_like(s), at[1]], axis=1)


def _first_guess(mesh: np.ndarray, clamped: bool) -> tuple[np.ndarray, np.ndarray]:
    y = np.zeros((4, mesh.size))
    y[0] = mesh
    if not clamped:
        # A parabola that sags as the rope does is near enough for the first, stiffest rope.
        sag = np.sqrt(3 * SPAN * (LENGTH - np.hypot(SPAN, DROP)) / 8)
        y[0] = SPAN * mesh
        y[1] = DROP * mesh - 4 * sag * mesh * (1 - mesh)
        y[2] = np.arctan2(np.gradient(y[1]), np.gradient(y[0]))
        y[3] = 0.1 * np.gradient(y[2], mesh)
    return y, np.array([0.3, -0.5])


def describe(
    ends: str, ratio: float, nodes: int = 41, shape: dict[str, Any] | None = None, **changes: Any
) -> RopeDescription:
    """The rope of `elastica` at `nodes` nodes; `shape` goes to `elastica`, `changes` replace."""
    n = nodes - 1
    x = elastica(ends, ratio, np.linspace(0, 1, nodes), **(shape or {}))
    inner = np.linspace(0, 1, nodes)[1:-1]
    stiffness = (shape or {}).get("stiffness", np.ones_like)(inner)
    curvature = (shape or {}).get("curvature", np.zeros_like)(inner)
    bending = ratio * MASS * G * LENGTH**2 * stiffness
    masses = np.full(nodes, MASS / n)
    masses[[0, -1]] /= 2
    masses[-1] += (shape or {}).get("tip", 0.0) * MASS
    positions = np.stack([x[0], x[-1]])[None]
    orientation = np.full((1, 2, 4), np.nan)
    if ends == "clamped":
        positions[0, 1] = np.nan
        orientation[0, 0] = from_vector(np.array([0.0, np.pi / 2, 0.0]))  # e3 to +x, e2 = +y
    given: dict[str, Any] = {
        "length": LENGTH,
        "rest_lengths": np.full(n, LENGTH / n),
        "EA": np.full(n, np.inf),
        "GA": np.full(n, np.inf),
        "EI": bending,
        "GJ": bending / 1.3,
        # Towards +z is a turn about -y, the material axis e2 reversed.
        "rest_curvature": np.stack([np.zeros(n - 1), -curvature], axis=1),
        "rest_twist": np.zeros(n - 1),
        "masses": masses,
        "diameter": 0.008,
        "gravity": np.array([0.0, 0.0, -G]),
        "end_kinds": ("clamped", "free") if ends == "clamped" else ("pinned", "pinned"),
        "end_positions": positions,
        "end_orientations": orientation,
        "x": x[None],
    }
    return RopeDescription(**(given | changes))
