"""Random ropes moved quasi-statically from pose to pose, and checks of the states found: against
the boundary-value problem of the rope's differential equations, and for whole turns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.robustness.random_ropes import Paths, paths
from reference_simulators.collocation import NotConverged
from reference_simulators.collocation import solve as collocate
from reference_simulators.kirchhoff_rod import CLAMPED, PINNED, Ends, problem
from reference_simulators.rod_equations import Rod as Continuous
from ropefit.rod.quaternion import CONJUGATE, conjugate_product, multiply
from ropefit.rod.rod import Rod, build, uniform
from ropefit.solvers.equilibrium.branches import follow, turned_over
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import ARRAYS, Solution, States
from ropefit.solvers.equilibrium.solve import solve

DOWN = np.array([0.0, 0.0, -1.0])  # a rope of 1 m weighs 1 N
TWIST = 2 / 3  # GJ over EI, that of `uniform`
SHARP = np.pi / 2  # rad: bent more than that a joint gives way
FINER = 8  # times the segments, to be compared with the boundary-value solution
ELEMENTS = 240


class QuasiStatic(NamedTuple):
    """C ropes in T frames: bend (C,) EI [N m²], paths, end conditions and states, rope by rope."""

    bend: np.ndarray
    paths: Paths
    conditions: list[Conditions]
    states: list[Solution]


def follow_random_paths(
    count: int, clamped: bool, nodes: int, frames: int, seed: int
) -> QuasiStatic:
    """Solve random ropes of 1 m and 1 N, EI 1e-6 to 1e-1 N m², each frame from the one before."""
    rng = np.random.default_rng(seed)
    bend = 10 ** rng.uniform(-6, -1, count)
    way = paths(rng, count, np.linspace(0, 1, frames), 10 ** rng.uniform(-2, 0.3, count), 1.0)
    clamp = way.clamp if clamped else np.full_like(way.clamp, np.nan)
    held = [Conditions(*pair) for pair in zip(way.ends, clamp, strict=True)]
    states = [follow(rope(b, nodes - 1, clamped), c) for b, c in zip(bend, held, strict=True)]
    return QuasiStatic(bend, way, held, states)


def rope(bend: float | np.ndarray, segments: int, clamped: bool) -> Rod:
    """Return the rod of 1 m and 1 N with EI `bend` [N m²]."""
    return build(uniform(length=1.0, segments=segments, bend=bend), DOWN, (clamped, clamped))


def concatenated(states: list[Solution], rod: Rod, conditions: Conditions) -> Solution:
    """Return one solution of all frames, each of a rope of its own."""
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(s, name) for s in states]) for name in ARRAYS
    }
    return Solution(**arrays, rod=rod, conditions=conditions)


def whole_turns(m: QuasiStatic) -> np.ndarray:
    """Return whether (C, T-1) a rope winds up by an odd number of whole turns between two frames.

    False where a joint is bent so sharply that it may fold over instead.
    """
    out = []
    for held, state in zip(m.conditions, m.states, strict=True):
        late = np.arange(1, len(state.x))
        turned = turned_over(
            held.frames(late - 1), state.frames(late - 1), held.frames(late), state.frames(late)
        )
        sharp = largest_joint_angle(held, state) > SHARP
        out.append(turned & ~sharp[1:] & ~sharp[:-1])
    return np.stack(out)


def largest_joint_angle(held: Conditions, state: Solution) -> np.ndarray:
    """Return the largest angle (F,) [rad] between neighbouring material frames."""
    every = np.concatenate([held.clamp[:, :1], state.q, held.clamp[:, 1:]], axis=1)
    real = np.minimum(np.abs((every[:, 1:] * every[:, :-1]).sum(-1)), 1)
    return 2 * np.arccos(np.nan_to_num(real, nan=1.0)).max(-1)


def distance_to_reference(
    m: QuasiStatic, index: int, frame: int, clamped: bool
) -> tuple[float, float]:
    """Return the largest distance [m] of a node from the boundary-value solution next to it.

    Of the state, and of the state of a rope of FINER times the segments that was started from it.
    NaN where no solution is found.
    """
    held = m.conditions[index].frames(np.array([frame]))
    state = m.states[index].frames(np.array([frame]))
    bend, coarse = m.bend[index], state.q.shape[1]
    n = coarse * FINER
    nodes = np.zeros((1, n + 1, 3))
    begun = States(np.repeat(state.q, FINER, 1), nodes, state.base, state.reaction)
    fine = solve(rope(bend, n, clamped), held, begun)
    if not fine.converged[0]:
        return np.nan, np.nan
    if clamped:
        outer = held.clamp[0]
    else:  # nothing holds the spin: as the rope has it
        outer = fine.q[0, [0, -1]]
    kind = CLAMPED if clamped else PINNED
    rod = Continuous(1.0, 1 / 9.81, bend, TWIST * bend)
    exact = problem(rod, Ends(held.ends, outer[None], (kind, kind)), ELEMENTS)
    try:
        y = collocate(exact, _guess(fine, outer, bend, exact.mesh), 1e-9, 40)
    except (NotConverged, np.linalg.LinAlgError, ValueError):
        return np.nan, np.nan
    x = CubicSpline(exact.mesh, y[0, :, :3])(np.linspace(0, 1, coarse + 1))
    far = [np.linalg.norm(x - x0, axis=1).max() for x0 in (state.x[0], fine.x[0, ::FINER])]
    return float(far[0]), float(far[1])


def _guess(state: Solution, outer: np.ndarray, bend: float, mesh: np.ndarray) -> np.ndarray:
    """Return (1, M, 13): position, quaternion, force and moment on a mesh (M,) between the discrete
    ones; outer (2, 4): the frames at the very ends."""
    arc = np.linspace(0, 1, state.q.shape[1] + 1)
    middle = 0.5 * (arc[1:] + arc[:-1])
    q = np.concatenate([outer[:1], state.q[0], outer[1:]])
    q *= np.cumprod(np.r_[1.0, np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0)])[:, None]
    at = np.r_[0.0, middle, 1.0]
    bent = conjugate_product(q[:-1], q[1:])
    own = 2 * bend * np.array([0, 1, 1, TWIST]) * bent / np.diff(at)[:, None]
    moment = multiply(multiply(q[:-1], own), q[:-1] * CONJUGATE)
    parts = [
        (arc, state.x[0]), (at, q), (middle, state.force[0]),
        (0.5 * (at[1:] + at[:-1]), moment[:, 1:]),
    ]  # fmt: skip
    y = np.concatenate([np.stack([np.interp(mesh, s, v) for v in w.T], 1) for s, w in parts], 1)
    y[:, 3:7] /= np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
    return y[None]
