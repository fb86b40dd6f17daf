"""Other equilibria under the same conditions, and states that follow from frame to frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.rod.quaternion import conjugate_product, multiply, normalise
from ropefit.rod.rod import Rod
from ropefit.solvers.arrays import as_numpy
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.equilibrium.solve import solve

DIFFERENT = 1e-3  # of the length: states that lie nearer are the same
WHOLE = 1.5 * np.pi  # rad: twist that differs by more differs by a turn
HALVINGS = 4  # of a step from frame to frame


def other_states(solution: Solution) -> tuple[Solution, np.ndarray]:
    """Return a second stable equilibrium of each frame, and how far it is (F,) [m] or NaN.

    Looked for from the catenary and from the state turned half way about the clamp's tangent (a
    cantilever that may fall to either side). A rope that is wound by whole turns is another rope.
    """
    rod, conditions = solution.rod, solution.conditions
    best, far = solution.copy(), np.full(len(solution.x), np.nan)
    starts: list[States | None] = [None]
    for end in range(2):
        if not np.isnan(conditions.clamp[:, end]).any():
            starts.append(_turned(solution, end))
    least = DIFFERENT * float(rod.length.reshape(-1, rod.length.shape[-1])[0].sum())
    for start in starts:
        found = solve(rod, conditions, start)
        apart = np.abs(found.x - solution.x).max(axis=(1, 2))
        new = found.converged & (apart > least) & ~(apart <= np.nan_to_num(far, nan=0.0))
        new &= ~wound(found, solution)
        best.put(new, found, new)
        far[new] = apart[new]
    return best, far


def wound(solution: Solution, before: States) -> np.ndarray:
    """Return (F,) bool: frames between two clamps a whole turn of twist or more from `before`.

    No small change of anything does that: such a state was jumped to.
    """
    clamp = solution.conditions.clamp
    if np.isnan(clamp).any():
        return np.zeros(len(solution.q), dtype=bool)
    both = as_numpy(clamp)
    return np.abs(_twist(both, solution.q) - _twist(both, before.q)) > WHOLE


def overwound(solution: Solution, before: States) -> np.ndarray:
    """Return (F,) bool: frames that `wound` says and that are then twisted by nearly a turn.

    How often a rope was wound before it was clamped no orientation of the clamps tells; up to half
    a turn to either side is as good a guess as any.
    """
    twist = _twist(as_numpy(solution.conditions.clamp), solution.q)
    return wound(solution, before) & (np.abs(twist) > WHOLE)


def _twist(clamp: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (F,) [rad] by which the frames turn about their tangents from clamp to clamp."""
    every = np.moveaxis(np.concatenate([clamp[:, :1], q, clamp[:, 1:]], axis=1), -1, 0)
    a, b = every[..., :-1], every[..., 1:]
    # Of a* b, the turn from frame to frame, the two components that tell it about the tangent.
    whole = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    about = a[0] * b[3] - a[3] * b[0] + a[2] * b[1] - a[1] * b[2]
    # Of the two quaternions of a turn the one of the smaller angle.
    angle = 2 * np.arctan2(about, whole)
    return (np.mod(angle + np.pi, 2 * np.pi) - np.pi).sum(-1)


def _turned(solution: Solution, end: int) -> States:
    """Return the states turned by half a turn about a clamp's tangent, its frame left as it is."""
    clamp = solution.conditions.clamp[:, end : end + 1]
    spin = np.array([0.0, 0.0, 0.0, 1.0])
    turned = multiply(multiply(spin, conjugate_product(clamp, solution.q)), -spin)
    start = solution.states
    start.q[:] = multiply(clamp, turned)
    start.reaction[:] = 0.0
    return start


def follow(rod: Rod, conditions: Conditions) -> Solution:
    """Find equilibria of F frames in which each state follows from the one before.

    Where a step from frame to frame fails or winds the rope by a turn it is taken in halves. Where
    following fails the state is found anew from the catenary.
    """
    out = solve(rod, conditions)
    for t in range(1, len(out.x)):
        here, there = (conditions.frames(np.array([k])) for k in (t - 1, t))
        found = _led(rod, here, there, out.frames(np.array([t - 1])), HALVINGS)
        if found.converged[0]:
            out.put(t, found, 0)
    return out


def _led(
    rod: Rod, here: Conditions, there: Conditions, before: Solution, halvings: int
) -> Solution:
    """Return the state of one frame led from `before`, which is `here`, to `there`."""
    found = solve(rod, there, before)
    if found.converged[0] and not turned_over(here, before, there, found)[0]:
        return found
    if halvings == 0:
        return found
    # Of the two quaternions of a clamp the one nearer to where it was.
    same = np.sign((here.clamp * there.clamp).sum(-1, keepdims=True))
    middle = replace(
        there,
        ends=0.5 * (here.ends + there.ends),
        clamp=normalise(here.clamp + same * there.clamp),
    )
    half = _led(rod, here, middle, before, halvings - 1)
    if not half.converged[0]:
        return found
    led = _led(rod, middle, there, half, halvings - 1)
    return led if led.converged[0] else found


def turned_over(
    here: Conditions, before: Solution, there: Conditions, after: Solution
) -> np.ndarray:
    """Return (F,) bool: frames wound by an odd number of whole turns from `before`.

    Between two clamps; `before` was under the conditions `here`. Exact whatever the clamps and the
    shape did meanwhile, as long as no joint is bent by half a turn: along the rope quaternions go
    on, or are the negative of that.
    """
    if np.isnan(here.clamp).any():
        return np.zeros(len(after.q), dtype=bool)
    moved = np.sign((here.clamp * there.clamp).sum(-1)).prod(-1)
    return _sheet(here.clamp, before.q) * _sheet(there.clamp, after.q) * moved < 0


def _sheet(clamp: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return (F,) 1 or -1: whether the quaternions go on from one clamp to the other."""
    every = np.concatenate([clamp[:, :1], q, clamp[:, 1:]], axis=1)
    return np.sign((every[:, 1:] * every[:, :-1]).sum(-1)).prod(-1)
