"""The reference problems in ropefit's own terms: the only module here that builds its objects."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from reference_simulators.planar_elastica import Along, Guess, Planar, from_stiffer_ropes
from ropefit.exporters import RopeDescription
from ropefit.exporters.rotation import from_vector
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution

LENGTH, MASS, G = 1.0, 0.05, 9.81  # of the described rope: m, kg, m/s²
SPAN, DROP = 0.6, 0.1  # m, from one of its pinned ends to the other


def upright(angle: float) -> np.ndarray:
    """Return the quaternion (4,) of the frame whose third director is (cos θ, 0, sin θ)."""
    half = 0.5 * (math.pi / 2 - angle)
    return np.array([math.cos(half), 0.0, math.sin(half), 0.0])


def planar(p: Planar, segments: int, density: float = 1.0) -> tuple[Rod, Conditions]:
    """Discretise a planar reference problem, in one frame; its weight is density times gravity."""
    clamped = (p.first is not None, p.last is not None)
    properties = uniform(
        length=p.length,
        segments=segments,
        bend=p.bend,
        axial=p.axial,
        shear=p.shear,
        density=density,
        curvature=(0.0, -p.curvature, 0.0),  # a turn about y lowers θ
    )
    down = np.array([0.0, 0.0, -p.weight / density])
    rod = build(properties, down, clamped)
    load, moment = rod.load.copy(), rod.moment.copy()
    load[-1] += [p.force[0], 0.0, p.force[1]]
    moment[1, 1] = -p.moment
    ends = np.zeros((1, 2, 3))
    ends[0, 1] = np.nan
    if p.far is not None:
        ends[0, 1] = [p.far[0], 0.0, p.far[1]]
    clamp = np.full((1, 2, 4), np.nan)
    for end, angle in enumerate((p.first, p.last)):
        if angle is not None:
            clamp[0, end] = upright(angle)
    return rod._replace(load=load, moment=moment), Conditions(ends, clamp)


def guess_of(rod: Rod, solution: Solution) -> Guess:
    """Return a discrete state as the initial guess of a reference solution.

    Only the branch and the time depend on it, not the answer.
    """
    arc, x, n = rod.arc, solution.x[0], solution.force[0]
    edge = np.diff(x, axis=0)
    angle = np.unwrap(np.arctan2(edge[:, 2], edge[:, 0]))
    middle = 0.5 * (arc[1:] + arc[:-1])
    slope = np.array([0.0, np.diff(n[:, 2]).mean() * len(n) / arc[-1]])
    force = n[0, [0, 2]] - slope * middle[0]
    return Guess(arc, np.interp(arc, middle, angle), x[:, 0], x[:, 2], force)


def describe(
    ends: str,
    ratio: float,
    nodes: int = 41,
    stiffness: Along = np.ones_like,
    curvature: Along = np.zeros_like,
    tip: float = 0.0,
    **changes: Any,
) -> RopeDescription:
    """Return a rope at rest, 1 m long and of 50 g, as the exporters take it.

    ends: "pinned" at the origin and (SPAN, 0, DROP), or "clamped" horizontally at the origin and
    free; ratio: EI / (w L³). stiffness(s): EI over that EI; curvature(s): rest curvature [1/m]
    towards +z; tip: a mass hung on the free end, in rope masses. `changes` replace fields.
    """
    n, clamped = nodes - 1, ends == "clamped"
    rope = Planar(
        1.0, ratio, 1.0, far=None if clamped else (SPAN, DROP), first=0.0 if clamped else None,
        force=(0.0, -tip), factor=stiffness, bent=curvature,
    )  # fmt: skip
    s = np.linspace(0, 1, nodes)
    place = from_stiffer_ropes(rope, s)
    x = np.stack([place[:, 0], np.zeros(nodes), place[:, 1]], axis=1)
    bending = ratio * MASS * G * LENGTH**2 * stiffness(s[1:-1])
    masses = np.full(nodes, MASS / n)
    masses[[0, -1]] /= 2
    masses[-1] += tip * MASS
    positions = np.stack([x[0], x[-1]])[None]
    orientation = np.full((1, 2, 4), np.nan)
    if clamped:
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
        "rest_curvature": np.stack([np.zeros(n - 1), -curvature(s[1:-1])], axis=1),
        "rest_twist": np.zeros(n - 1),
        "masses": masses,
        "diameter": 0.008,
        "gravity": np.array([0.0, 0.0, -G]),
        "end_kinds": ("clamped", "free") if clamped else ("pinned", "pinned"),
        "end_positions": positions,
        "end_orientations": orientation,
        "x": x[None],
    }
    return RopeDescription(**(given | changes))
