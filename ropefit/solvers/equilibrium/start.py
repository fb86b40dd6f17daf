"""Where a solve starts: the catenary through the ends, or a straight rope where an end is free."""

from __future__ import annotations

import numpy as np

from ropefit.rod.either import Array, like, namespace
from ropefit.rod.quaternion import transport
from ropefit.solvers.arrays import as_numpy, in_threads
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.kernels.entries import hang_rope, start_ropes
from ropefit.solvers.equilibrium.problem import Problem
from ropefit.solvers.equilibrium.solution import Solution, States, same_supports
from ropefit.solvers.shapes import check_shapes


def hanging_shape(
    length: float, nodes: int, gravity: np.ndarray, ends: np.ndarray, tangents: np.ndarray
) -> np.ndarray:
    """Return the centreline (K, 3) [m] that a rope without stiffness would have at rest, evenly
    spaced in arc length.

    ends, tangents: (2, 3), NaN where free or unclamped. Both ends: catenary (straight when taut; an
    arbitrary plane when one end hangs exactly above the other). One end: straight along its
    tangent, or down. Raises ValueError when both are free.
    """
    held = np.isfinite(ends).all(axis=1)
    if not held.any():
        raise ValueError("a rope with two free ends has no place to start from")
    shape = np.empty((nodes, 3))
    end = np.ascontiguousarray(ends, dtype=np.float64)
    tangent = np.ascontiguousarray(tangents, dtype=np.float64)
    arc = np.linspace(0.0, length, nodes)
    hang_rope(arc, np.ascontiguousarray(gravity, dtype=np.float64), end, tangent, shape)
    return shape


def frames_along(x: Array, first: Array | None = None, last: Array | None = None) -> Array:
    """Return twist-free frames (..., K-1, 4) of a centreline x (..., K, 3), clamps in their places.

    first, last: (..., 4) held frames of the first and last segment, NaN where not held. The frames
    run from the first clamp if there is one, so that their arbitrary turn about the tangent is the
    clamp's.
    """
    xp = namespace(x)
    edges = x[..., 1:, :] - x[..., :-1, :]
    norm = xp.sqrt((edges * edges).sum(-1)[..., None] + 1e-24)
    tangents = xp.where(norm > 1e-11, edges / norm, like([0.0, 0.0, 1.0], x))
    q = transport(tangents)
    for index, held in ((0, first), (-1, last)):
        if held is not None:
            given = xp.isfinite(held).all(-1)[..., None]
            near = q[..., index, :]
            held = xp.where(given, held, near)
            against = (held * near).sum(-1)[..., None] < 0
            place = xp.zeros_like(q[..., :1], dtype=xp.bool)
            place[..., index, :] = True
            q = xp.where(place, xp.where(against, -held, held)[..., None, :], q)
    return q


def starting(
    problem: Problem,
    conditions: Conditions,
    start: States | None = None,
    turns: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where a solve begins: frames q (F, N, 4), reactions (F, S) [N], base (F, 3) [m].

    Catenaries, or copies of `start`. Reactions of supports other than the far end's are known from
    a solution with the same supports only, else zero.
    """
    frames, segments = len(conditions.ends), problem.rods.length.shape[1]
    if start is None:
        with np.errstate(invalid="ignore"):  # NaN and infinite loads: the status will say so
            q, reaction, base = _catenaries(problem, conditions, turns)
    else:
        check_shapes(start=(start.q, (frames, segments, 4)))
        q, base = start.q.copy(), start.base.copy()
        reaction = np.zeros((frames, problem.held.node.size))
        known = conditions.far_supports
        if isinstance(start, Solution) and same_supports(start.conditions, conditions):
            known = min(start.reaction.shape[1], reaction.shape[1])
        known = min(known, start.reaction.shape[1])
        reaction[:, :known] = start.reaction[:, :known]
    if not conditions.free:
        base = as_numpy(conditions.ends[:, 0]).copy()
    return q, reaction, base


def _catenaries(
    problem: Problem, conditions: Conditions, turns: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return catenaries, with the tension they have at the far end."""
    rods, of, held = problem
    frames, segments = len(conditions.ends), rods.length.shape[1]
    arc = np.zeros((len(rods.length), segments + 1))
    np.cumsum(rods.length, axis=1, out=arc[:, 1:])
    weight = rods.load.sum(axis=1)
    ends, clamp = as_numpy(conditions.ends), as_numpy(conditions.clamp)  # NaN where not held
    q, x, pull = (np.empty((frames, *shape)) for shape in ((segments, 4), (segments + 1, 3), (3,)))
    turns = np.zeros(frames) if turns is None else np.asarray(turns, dtype=np.float64)
    check_shapes(
        arc=(arc, (len(weight), segments + 1)), weight=(weight, (len(arc), 3)),
        ends=(ends, (frames, 2, 3)), clamp=(clamp, (frames, 2, 4)), turns=(turns, (frames,)),
    )  # fmt: skip

    load = np.ascontiguousarray(rods.load[:, -1])
    rolls = bool(np.isnan(clamp).any(-1).all())  # nothing keeps it from that

    def work(index: slice) -> None:
        start_ropes(
            arc, of[index], weight, ends[index], clamp[index], turns[index], rods.rest, rolls, load,
            q[index], x[index], pull[index],
        )  # fmt: skip

    in_threads(work, frames)
    reaction = np.zeros((frames, held.node.size))
    if conditions.far_held:
        reaction[:, :3] = pull
    return q, reaction, x[:, 0].copy()
