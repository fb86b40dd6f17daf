"""History-dependent ropes: Kirchhoff's rod pose after pose, with internal friction or creep.

In each element of the mesh a second bending rigidity acts beside the rope's own, on the curvature
less what has slipped or flowed of it. Between two frames the ends go on a smooth path in `STEPS`
small steps; what flows follows the trapezoidal rule, what slips the return to the yield circle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from reference_simulators import inner_friction
from reference_simulators.kirchhoff_rod import CLAMPED, Ends, RodProblem, follow
from reference_simulators.rod_equations import Array, Inside, Rod, curvatures, rotation

STEPS = 4  # from frame to frame


@dataclass(frozen=True)
class Law:
    """An inelastic bending rigidity [N m²] beside the rope's own.

    slip [1/m]: the largest elastic curvature; time [s]: its relaxation time (infinite: no creep).
    fresh: without moment when straight, else in the first frame. dahl: it does not slip at once
    but by Dahl's law (1968), of which `slip` is the range, from no moment in the first frame.
    """

    rigidity: float
    slip: float
    time: float
    fresh: bool
    dahl: bool = False


def shapes(problem: RodProblem, law: Law, states: Array, interval: float) -> Array:
    """Return states (T, N + 1, 13) of frames `interval` [s] apart, from the elastic rope's states.

    The rope's own rigidity is that of `problem.rod`.
    """
    held, elements = problem.held, len(problem.mesh) - 1
    inelastic = np.zeros((elements, 2))  # the part of the curvature that has slipped or flowed
    y, before = states[:1], np.zeros((elements, 2))
    if not law.fresh:
        before = _curvature(problem, problem.rod, y)
        inelastic = before
    out = []
    for ends in _path(held):
        first = not out and law.fresh is False
        if not first:
            y, now = _settled(problem, law, ends, inelastic, before, y, interval / STEPS)
            inelastic, before = _moved(law, inelastic, before, now, interval / STEPS), now
        out.append(y[0])
    return np.array(out[::STEPS])


def _path(held: Ends) -> list[Ends]:
    """Return the ends in every step, on splines through the frames."""
    frames = len(held.positions)
    at = np.linspace(0, frames - 1, (frames - 1) * STEPS + 1)
    places = CubicSpline(np.arange(frames), held.positions)(at)
    turns = CubicSpline(np.arange(frames), held.orientations)(at)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    return [Ends(p[None], q[None], held.kinds) for p, q in zip(places, turns, strict=True)]


def _settled(
    problem: RodProblem,
    law: Law,
    ends: Ends,
    inelastic: Array,
    before: Array,
    y: Array,
    step: float,
) -> tuple[Array, Array]:
    """Return the state and curvatures at new ends.

    What flows within the step is a softer spring.
    """
    if law.dahl:
        inside = Inside(law.rigidity, before, law.slip, before - inelastic)
        rod = replace(problem.rod, inside=inside)
        y = follow(lambda _: replace(problem, rod=rod, held=ends, gauge=False), y)
        return y, _curvature(problem, rod, y)
    half = 0.5 * step / law.time
    # e = k - inelastic follows (1 + half) e = (1 - half) e_before + k - k_before.
    rigidity = law.rigidity / (1 + half)
    centre = before - (1 - half) * (before - inelastic)
    rod = replace(problem.rod, inside=Inside(rigidity, centre, law.slip * (1 + half)))
    free = CLAMPED not in ends.kinds and problem.rod.isotropic and not np.abs(centre).any()
    goal = replace(problem, rod=rod, held=ends, gauge=free)
    y = follow(lambda _: goal, y)
    return y, _curvature(problem, rod, y)


def _curvature(problem: RodProblem, rod: Rod, y: Array) -> Array:
    """Return curvatures (N, 2) [1/m] in the elements' middles."""
    turn = rotation(y[0, :, 3:7])
    body = np.einsum("nji,nj->ni", turn, y[0, :, 10:])
    middle = 0.5 * (problem.mesh[1:] + problem.mesh[:-1])
    return curvatures(rod, middle, 0.5 * (body[1:] + body[:-1])[None])[0][0, :, :2]


def _moved(law: Law, inelastic: Array, before: Array, now: Array, step: float) -> Array:
    """Return the inelastic curvature once the curvature is `now`."""
    if law.dahl:
        return now - inner_friction.strained(now - before, law.slip, before - inelastic)
    half = 0.5 * step / law.time
    held = ((1 - half) * (before - inelastic) + now - before) / (1 + half)
    size = np.linalg.norm(held, axis=1, keepdims=True)
    return now - held * np.minimum(1.0, law.slip / np.maximum(size, 1e-300))
