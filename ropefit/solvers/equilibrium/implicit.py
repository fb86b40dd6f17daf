"""Derivatives of equilibria by the implicit function theorem: one more linear solve, no iteration.

`tangent` gives forward derivatives in chosen directions, for least squares; `pulled` those of a
function of the states (adjoint), from which `differentiable.py` makes a function in torch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.rod.fields import ROD, names, shapes, zeros
from ropefit.rod.setup import Follower
from ropefit.solvers.arrays import in_threads
from ropefit.solvers.equilibrium.followers import (
    Settle,
    closed,
    pulled_through,
    solve_with_followers,
)
from ropefit.solvers.equilibrium.kernels.entries import adjoint_ropes, tangent_ropes
from ropefit.solvers.equilibrium.kernels.records import HELD_GRADIENT, Change, Pull
from ropefit.solvers.equilibrium.problem import Problem, cut
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.shapes import check_shapes

AT_ONCE = 4  # frames whose directions are spread over all fields: memory
# Fields whose change is one of bend elements, and those whose change is one of segments.
ACTING = ("stiffness", "rest"), ("length", "flexibility", "load")


def pulled(s: Solution, gx: np.ndarray, gq: np.ndarray) -> Pull:
    """Return the gradients of each frame, in its rod and in what holds it, from those in its nodes
    gx (F, N+1, 3) and frames gq (F, N, 4)."""
    problem, (frames, segments) = s.problem, s.q.shape[:2]
    check_shapes(gx=(gx, (frames, segments + 1, 3)), gq=(gq, (frames, segments, 4)))
    if s.followers:
        gq = pulled_through(s, gx, gq, _by_loads)
    supports = problem.held.node.size
    pulls = Pull(**zeros((*ROD, *HELD_GRADIENT), (frames,), segments, S=supports))

    def work(index: slice) -> None:
        adjoint_ropes(
            *cut(problem, index), s.q[index], s.reaction[index], s.base[index], gx[index],
            gq[index], Pull(*(item[index] for item in pulls)),
        )  # fmt: skip

    in_threads(work, frames)
    return pulls


class Directions(NamedTuple):
    """P directions of change for `tangent`; what is None does not change.

    Of R ropes: the fields of `rod.fields.ROD`, with a dimension of P between that of the ropes and
    their own: length (R, P, N), moment (R, P, 2, 3). Of F frames: ends (F, P, 2, 3) [m], clamp
    (F, P, 2, 3) as a turn [rad] about the clamp's own axes, offset (F, P, S) of the supports given
    with the conditions.
    """

    length: np.ndarray | None = None
    flexibility: np.ndarray | None = None
    stiffness: np.ndarray | None = None
    rest: np.ndarray | None = None
    load: np.ndarray | None = None
    moment: np.ndarray | None = None
    ends: np.ndarray | None = None
    clamp: np.ndarray | None = None
    offset: np.ndarray | None = None


def tangent(solution: Solution, directions: Directions) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives of a solution's states for a unit step in each of P directions: dx
    (F, P, N+1, 3) [m] and turns of the frames (F, P, N, 3) [rad], about their own directors.

    Directions of F ropes may be given for the one rope of a solution's F frames. Raises ShapeError
    where a direction is not of the solution's shape.
    """
    dx, turn = _under_dead_loads(solution, directions)
    return closed(solution, dx, turn, _by_loads) if solution.followers else (dx, turn)


def _by_loads(solution: Solution, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return _under_dead_loads(solution, Directions(load=load))


def _under_dead_loads(solution: Solution, directions: Directions) -> tuple[np.ndarray, np.ndarray]:
    """Return what `tangent` does, with the loads of followers as they are."""
    frames, segments = solution.q.shape[:2]
    problem = solution.problem
    many = next(item.shape[1] for item in directions if item is not None)
    given = {name: item for name in names(ROD) if (item := getattr(directions, name)) is not None}
    alike = len(problem.rods.length) == 1 and all(len(item) == 1 for item in given.values())
    whole = _change(given, 1, many, segments) if alike else None
    count = problem.held.node.size
    acts = _acting(given, many)
    ends = _or_zero(directions.ends, (frames, many, 2, 3))
    clamp = _or_zero(directions.clamp, (frames, many, 2, 3))
    offset = np.zeros((frames, many, count))
    far = solution.conditions.far_supports
    if far:
        offset[:, :, :3] = ends[:, :, 1]
    if directions.offset is not None:
        offset[:, :, far:] = directions.offset
    anchor = np.ascontiguousarray(ends[:, :, 0])
    dx = np.zeros((frames, many, segments + 1, 3))
    turn = np.zeros((frames, many, segments, 3))

    def work(index: slice) -> None:
        s = solution
        for k in range(index.start, index.stop, AT_ONCE):
            few = slice(k, min(k + AT_ONCE, index.stop))
            part, change = cut(problem, few), whole
            if change is None:
                own = {name: _of_frames(item, problem, few) for name, item in given.items()}
                part = _one_rope_each(part)
                change = _change(own, few.stop - few.start, many, segments)
            tangent_ropes(
                *part, s.q[few], s.reaction[few], s.base[few], change,
                acts, clamp[few], anchor[few], offset[few], dx[few], turn[few],
            )  # fmt: skip

    in_threads(work, frames)
    return dx, turn


def _acting(given: dict[str, np.ndarray], many: int) -> np.ndarray:
    """Return (2, P) which of `many` directions change bend elements, and which segments."""
    out = np.zeros((2, many), dtype=np.bool_)
    for fields, row in zip(ACTING, out, strict=True):
        for name in fields:
            item = given.get(name)
            if item is not None:
                row |= item.any(axis=(0, *range(2, item.ndim)))
    return out


def _change(given: dict[str, np.ndarray], ropes: int, many: int, segments: int) -> Change:
    """Return the change of some ropes in `many` directions, zero where none is given."""
    return Change(**{
        # A copy: compiled code tells writable arrays from others.
        name: _or_zero(given.get(name), (ropes, many, *shape))
        for name, shape in shapes(ROD, segments).items()
    })  # fmt: skip


def _of_frames(item: np.ndarray, problem: Problem, few: slice) -> np.ndarray:
    """Return directions of ropes, or of frames, for some frames; one for all stays one."""
    if len(item) == 1:
        return item
    return item[problem.of[few]] if len(item) == len(problem.rods.length) else item[few]


def _one_rope_each(problem: Problem) -> Problem:
    """Return the problem with a row of the rods' arrays for every frame."""
    rods, of, held = problem
    own = (np.ascontiguousarray(array[of]) for array in rods)
    return Problem(rods._make(own), np.arange(len(of)), held)


def _or_zero(given: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Return a copy of what is given, spread to a shape; zeros where nothing is. In C order: the
    solver is compiled anew for every other order."""
    if given is None:
        return np.zeros(shape)
    return np.array(np.broadcast_to(given, shape), dtype=np.float64, order="C")


def following(
    settle: Settle, followers: tuple[Follower, ...], start: States | None, every: bool = False
) -> Solution:
    """Return equilibria under forces that turn with the rope, as `settle` finds them under loads
    that stay (empty for none); every: no frame, where one of them does not settle."""
    return solve_with_followers(settle, followers, start, _by_loads, every)
