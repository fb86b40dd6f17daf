"""Ropes that remember: the rod's equations pose after pose, with friction or a fluid inside.

In each element of the mesh a second bending rigidity acts beside the rope's own, on the curvature
less what has slipped or flowed of it. Between two frames the ends go on a smooth path in `STEPS`
small steps; what flows follows the trapezoidal rule, what slips the return to the yield circle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.elastica import CLAMPED, Ends, RodProblem, follow
from benchmarks.discovery.rod_equations import Array, Inside, Rod, curvatures, rotation

STEPS = 4  # from frame to frame


@dataclass(frozen=True)
class Law:
    """rigidity [N m²] beside the rope's own; slip [1/m] that it bears at most, time [s] in which it
    flows (infinite: never). fresh: at ease when straight, else in the first frame."""

    rigidity: float
    slip: float
    time: float
    fresh: bool


def shapes(problem: RodProblem, law: Law, states: Array, interval: float) -> Array:
    """States (T, N + 1, 13) of frames `interval` [s] apart, from those of the rope without memory.

    The rope's own rigidity is that of `problem.rod`.
    """
    held, elements = problem.held, len(problem.mesh) - 1
    carried = np.zeros((elements, 2))  # what has slipped or flowed of the curvature
    y, before = states[:1], np.zeros((elements, 2))
    if not law.fresh:
        before = _curvature(problem, problem.rod, y)
        carried = before
    out = []
    for ends in _path(held):
        first = not out and law.fresh is False
        if not first:
            y, now = _settled(problem, law, ends, carried, before, y, interval / STEPS)
            carried, before = _moved(law, carried, before, now, interval / STEPS), now
        out.append(y[0])
    return np.array(out[::STEPS])


def _path(held: Ends) -> list[Ends]:
    """The ends in every step, on splines through the frames."""
    frames = len(held.positions)
    at = np.linspace(0, frames - 1, (frames - 1) * STEPS + 1)
    places = CubicSpline(np.arange(frames), held.positions)(at)
    turns = CubicSpline(np.arange(frames), held.orientations)(at)
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    return [Ends(p[None], q[None], held.kinds) for p, q in zip(places, turns, strict=True)]


def _settled(
    problem: RodProblem, law: Law, ends: Ends, carried: Array, before: Array, y: Array, step: float
) -> tuple[Array, Array]:
    """State and curvatures at new ends. What flows within the step is a softer spring."""
    half = 0.5 * step / law.time
    # e = k - carried follows (1 + half) e = (1 - half) e_before + k - k_before.
    rigidity = law.rigidity / (1 + half)
    centre = before - (1 - half) * (before - carried)
    rod = replace(problem.rod, inside=Inside(rigidity, centre, law.slip * (1 + half)))
    free = CLAMPED not in ends.kinds and problem.rod.isotropic and not np.abs(centre).any()
    goal = replace(problem, rod=rod, held=ends, gauge=free)
    y = follow(lambda _: goal, y)
    return y, _curvature(problem, rod, y)


def _curvature(problem: RodProblem, rod: Rod, y: Array) -> Array:
    """(N, 2) [1/m] in the elements' middles."""
    turn = rotation(y[0, :, 3:7])
    body = np.einsum("nji,nj->ni", turn, y[0, :, 10:])
    middle = 0.5 * (problem.mesh[1:] + problem.mesh[:-1])
    return curvatures(rod, middle, 0.5 * (body[1:] + body[:-1])[None])[0][0, :, :2]


def _moved(law: Law, carried: Array, before: Array, now: Array, step: float) -> Array:
    """What has slipped or flowed once the curvature is `now`."""
    half = 0.5 * step / law.time
    held = ((1 - half) * (before - carried) + now - before) / (1 + half)
    size = np.linalg.norm(held, axis=1, keepdims=True)
    return now - held * np.minimum(1.0, law.slip / np.maximum(size, 1e-300))
