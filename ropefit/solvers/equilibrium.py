"""The rod in equilibrium: Newton's method, differentiated by the implicit function theorem.

`solve` finds the states, `settle` makes them a differentiable function of the rod and its
conditions, `tangent` gives forward derivatives, `stability` the smallest eigenvalue. The compiled
work is in `newton_kernels.py`. All arrays float64 on the CPU.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.rod import Rod
from ropefit.solvers import newton_kernels as kernels
from ropefit.solvers.start import start_ropes
from ropefit.solvers.xpbd import State

TOLERANCE = 1e-10  # of the largest moment, and of the length
LIMIT = 200
ADVICE = {
    kernels.CONVERGED: "converged",
    kernels.LIMIT: "iteration limit reached; give more iterations or a nearer start",
    kernels.STUCK: "no step lowers the energy; are the ends farther apart than the rope is long?",
    kernels.NOT_FINITE: "not finite; look at the rod and its ends",
    kernels.UNSTABLE: "in equilibrium, but not stable",
}


@dataclass(frozen=True)
class Conditions:
    """What holds the rope in F frames.

    ends (F, 2, 3) [m] and clamp (F, 2, 4), NaN where not held. More supports: node (S,),
    direction (F, S, 3), offset (F, S) [m], compliance (F, S) [m/N], active (F, S): the force λ on
    the node along the direction obeys direction · x + compliance λ = offset.
    """

    ends: Tensor
    clamp: Tensor
    node: np.ndarray | None = None
    direction: Tensor | None = None
    offset: Tensor | None = None
    compliance: Tensor | None = None
    active: np.ndarray | None = None

    @property
    def free(self) -> bool:
        """Nothing holds node 0."""
        return bool(torch.isnan(self.ends[:, 0]).any())

    @property
    def far_held(self) -> bool:
        return not bool(torch.isnan(self.ends[:, 1]).any())

    def frames(self, index: Tensor | np.ndarray) -> Conditions:
        """The same for some of the frames."""
        index = torch.as_tensor(index)
        few = {
            name: value[index]
            for name in ("ends", "clamp", "direction", "offset", "compliance")
            if (value := getattr(self, name)) is not None
        }
        active = None if self.active is None else self.active[index.numpy()]
        return replace(self, active=active, **few)


@dataclass(frozen=True)
class Solution:
    """States of F frames and how they were found.

    q (F, N, 4), x (F, N+1, 3) [m], force (F, N, 3) [N] in the segments, reaction (F, S) [N] of the
    supports, base (F, 3) [m] of node 0, status (F,) see ADVICE, iterations (F,), residual (F,).
    """

    q: np.ndarray
    x: np.ndarray
    force: np.ndarray
    reaction: np.ndarray
    base: np.ndarray
    status: np.ndarray
    iterations: np.ndarray
    residual: np.ndarray

    @property
    def converged(self) -> np.ndarray:
        """(F,) bool."""
        return self.status == kernels.CONVERGED

    def frames(self, index: np.ndarray) -> Solution:
        return Solution(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def copy(self) -> Solution:
        return Solution(*(getattr(self, name).copy() for name in self.__dataclass_fields__))


class _Problem(NamedTuple):
    rods: kernels.Rods
    frames: kernels.Frames


def solve(
    rod: Rod,
    conditions: Conditions,
    start: Solution | None = None,
    member: np.ndarray | None = None,
    turns: np.ndarray | None = None,
    tolerance: float = TOLERANCE,
    limit: int = LIMIT,
) -> Solution:
    """Stable equilibria of F frames, each from the catenary through its ends or from `start`.

    member (F,): which of the rod's R ropes each frame shows (all the only one, or one each, if not
    given). turns (F,): whole turns of twist that a catenary start is given between two clamps.
    Never raises for a frame that does not converge: its status says so.
    """
    problem = _problem(rod, conditions, member)
    frames, segments = len(conditions.ends), problem.rods.length.shape[1]
    count = problem.frames.node.size
    if start is None:
        start = _start(problem, conditions, turns)
    q, lam, base = start.q.copy(), np.zeros((frames, count)), start.base.copy()
    lam[:, : start.reaction.shape[1]] = start.reaction[:, :count]
    if not conditions.free:
        base = _numpy(conditions.ends[:, 0])
    status, iterations = np.zeros(frames, dtype=np.int64), np.zeros(frames, dtype=np.int64)
    residual = np.empty(frames)
    x, force = np.empty((frames, segments + 1, 3)), np.empty((frames, segments, 3))

    def work(index: slice) -> None:
        kernels.solve_ropes(
            *_cut(problem, index), q[index], lam[index], base[index], tolerance, limit,
            status[index], iterations[index], residual[index], x[index], force[index],
        )  # fmt: skip

    _in_threads(work, frames)
    return Solution(q, x, force, lam, base, status, iterations, residual)


def _start(problem: _Problem, conditions: Conditions, turns: np.ndarray | None) -> Solution:
    """Catenaries, with the tension they have at the far end."""
    rods, held = problem
    frames, segments = len(conditions.ends), rods.length.shape[1]
    arc = np.zeros((len(rods.length), segments + 1))
    np.cumsum(rods.length, axis=1, out=arc[:, 1:])
    weight = rods.load.sum(axis=1)
    ends, clamp = _numpy(conditions.ends), held.clamp
    q, x, pull = (
        np.empty((frames, segments, 4)),
        np.empty((frames, segments + 1, 3)),
        np.empty(frames),
    )
    turns = np.zeros(frames) if turns is None else np.asarray(turns, dtype=np.float64)
    start_ropes(arc, rods.of, weight, ends, clamp, turns, q, x, pull)
    reaction = np.zeros((frames, held.node.size))
    if conditions.far_held:
        last = x[:, -1] - x[:, -2]
        size = np.linalg.norm(last, axis=1, keepdims=True)
        last = last / np.maximum(size, 1e-300)
        w = weight[rods.of]
        per_length = np.linalg.norm(w, axis=1, keepdims=True) / arc[rods.of, -1:]
        down = w / np.maximum(np.linalg.norm(w, axis=1, keepdims=True), 1e-300)
        along = (last * down).sum(1, keepdims=True)
        across = np.sqrt(np.maximum(1 - along**2, 1e-6))
        reaction[:, :3] = per_length * pull[:, None] / across * last
        if not conditions.free:
            reaction[:, :3] = np.clip(reaction[:, :3], -1e6, 1e6)
    base = x[:, 0].copy()
    empty = np.zeros(frames, dtype=np.int64)
    return Solution(q, x, np.zeros_like(q[..., :3]), reaction, base, empty, empty, np.zeros(frames))


class _Settle(torch.autograd.Function):
    """(rod, conditions) -> x, q of a solution already found; backward is one adjoint solve."""

    @staticmethod
    def forward(ctx, problem, solution, far, *inputs):
        ctx.problem, ctx.solution, ctx.far = problem, solution, far
        ctx.shapes = [None if t is None else t.shape for t in inputs]
        return torch.from_numpy(solution.x.copy()), torch.from_numpy(solution.q.copy())

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *grads):
        problem, far = ctx.problem, ctx.far
        g = _adjoint(problem, ctx.solution, _numpy(grads[0]), _numpy(grads[1]))
        rods = problem.rods
        by_rod = [g.length, g.supple, g.stiff, g.rest, g.load, g.moment]
        summed = [np.zeros((len(rods.length), *item.shape[1:])) for item in by_rod]
        for total, item in zip(summed, by_rod, strict=True):
            np.add.at(total, rods.of, item)
        ends = np.zeros((len(g.anchor), 2, 3))
        ends[:, 0] = g.anchor
        if far:
            ends[:, 1] = g.offset[:, :3]
        # A turn δ about the clamp's own axes is 2 Im(q* dq).
        w, v = problem.frames.clamp[..., :1], problem.frames.clamp[..., 1:]
        clamp = 2 * np.concatenate(
            [-(v * g.clamp).sum(-1, keepdims=True), w * g.clamp + np.cross(v, g.clamp)], axis=-1
        )
        rest = [ends, clamp, g.direction[:, far:], g.offset[:, far:], g.compliance[:, far:]]
        out = [
            None if shape is None else torch.from_numpy(item.copy()).reshape(shape)
            for shape, item in zip(ctx.shapes, [*summed, *rest], strict=True)
        ]
        return None, None, None, *out


def settle(
    rod: Rod,
    conditions: Conditions,
    start: Solution | None = None,
    member: np.ndarray | None = None,
    solution: Solution | None = None,
) -> tuple[State, Solution]:
    """`solve`, as a differentiable function: x (F, N+1, 3) [m] and q (F, N, 4), and how it went.

    Gradients reach every tensor of the rod and of the conditions, at the price of one more linear
    solve. Frames that did not converge are NaN. `solution`: of these very arguments, if known.
    """
    if solution is None:
        solution = solve(rod, conditions, start, member)
    problem = _problem(rod, conditions, member)
    c = conditions
    inputs = [*rod, c.ends, c.clamp, c.direction, c.offset, c.compliance]
    far = 3 if c.far_held else 0
    x, q = _Settle.apply(problem, solution, far, *inputs)  # type: ignore[misc]
    if not solution.converged.all():
        bad = torch.from_numpy(~solution.converged)[:, None, None]
        x, q = torch.where(bad, torch.nan, x), torch.where(bad, torch.nan, q)
    return State(x, q), solution


def _adjoint(problem: _Problem, s: Solution, gx: np.ndarray, gq: np.ndarray) -> kernels.Pull:
    frames, segments = s.q.shape[:2]
    count = problem.frames.node.size
    pulls = kernels.Pull(
        *(
            np.zeros((frames, *shape))
            for shape in [
                (segments,), (segments, 3), (segments + 1, 3), (segments + 1, 3),
                (segments + 1, 3), (2, 3), (2, 3), (3,), (count,), (count, 3), (count,),
            ]
        )
    )  # fmt: skip

    def work(index: slice) -> None:
        kernels.adjoint_ropes(
            *_cut(problem, index), s.q[index], s.reaction[index], s.base[index], gx[index],
            gq[index], kernels.Pull(*(item[index] for item in pulls)),
        )  # fmt: skip

    _in_threads(work, frames)
    return pulls


class Directions(NamedTuple):
    """P directions of change for `tangent`; what is None does not change.

    Of R ropes: length (R, P, N), supple (R, P, N, 3), stiff, rest and load (R, P, N+1, 3), moment
    (R, P, 2, 3). Of F frames: ends (F, P, 2, 3) [m], clamp (F, P, 2, 3) as a turn [rad] about the
    clamp's own axes, offset (F, P, S) of the supports given with the conditions.
    """

    length: np.ndarray | None = None
    supple: np.ndarray | None = None
    stiff: np.ndarray | None = None
    rest: np.ndarray | None = None
    load: np.ndarray | None = None
    moment: np.ndarray | None = None
    ends: np.ndarray | None = None
    clamp: np.ndarray | None = None
    offset: np.ndarray | None = None


def tangent(
    rod: Rod,
    conditions: Conditions,
    solution: Solution,
    directions: Directions,
    member: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the states: dx (F, P, N+1, 3) [m] and turns of the frames (F, P, N, 3) [rad],
    about their own directors, for a unit step in each of P directions."""
    problem = _problem(rod, conditions, member)
    frames, segments = solution.q.shape[:2]
    count, ropes = problem.frames.node.size, len(problem.rods.length)
    many = next(item.shape[1] for item in directions if item is not None)
    shapes = [
        (segments,), (segments, 3), (segments + 1, 3), (segments + 1, 3), (segments + 1, 3), (2, 3)
    ]  # fmt: skip
    change = kernels.Change(
        *(
            np.ascontiguousarray(
                np.broadcast_to(0.0 if given is None else given, (ropes, many, *shape)), np.float64
            )
            for given, shape in zip(directions[:6], shapes, strict=True)
        )
    )
    ends = _or_zero(directions.ends, (frames, many, 2, 3))
    clamp = _or_zero(directions.clamp, (frames, many, 2, 3))
    offset = np.zeros((frames, many, count))
    far = 3 if conditions.far_held else 0
    if far:
        offset[:, :, :3] = ends[:, :, 1]
    if directions.offset is not None:
        offset[:, :, far:] = directions.offset
    anchor = np.ascontiguousarray(ends[:, :, 0])
    dx = np.zeros((frames, many, segments + 1, 3))
    turn = np.zeros((frames, many, segments, 3))

    def work(index: slice) -> None:
        s = solution
        kernels.tangent_ropes(
            *_cut(problem, index), s.q[index], s.reaction[index], s.base[index], change,
            clamp[index], anchor[index], offset[index], dx[index], turn[index],
        )  # fmt: skip

    _in_threads(work, frames)
    return dx, turn


def stability(
    rod: Rod, conditions: Conditions, solution: Solution, member: np.ndarray | None = None
) -> np.ndarray:
    """(F,) [N] smallest eigenvalue of the energy's second derivative in the turns of the segments
    (per length), along what the supports allow. Positive: stable.

    The spin of a rope whose ends hold no twist costs nothing and is left out.
    """
    problem = _problem(rod, conditions, member)
    out = np.empty(len(solution.q))

    def work(index: slice) -> None:
        kernels.stability_ropes(
            *_cut(problem, index), solution.q[index], solution.reaction[index],
            solution.base[index], out[index],
        )  # fmt: skip

    _in_threads(work, len(out))
    return out


def _problem(rod: Rod, c: Conditions, member: np.ndarray | None) -> _Problem:
    frames = len(c.ends)
    length, supple, stiff, rest, load, moment = (
        _numpy(t if t.ndim == dim + 1 else t[None])
        for t, dim in zip(rod, (1, 2, 2, 2, 2, 2), strict=True)
    )
    ropes = max(len(item) for item in (length, supple, stiff, rest, load, moment))
    length, supple, stiff, rest, load, moment = (
        item if len(item) == ropes else np.repeat(item, ropes, axis=0)
        for item in (length, supple, stiff, rest, load, moment)
    )
    if member is None:
        if ropes not in (1, frames):
            raise ValueError(f"{ropes} ropes for {frames} frames: say which frame shows which")
        member = np.zeros(frames, dtype=np.int64) if ropes == 1 else np.arange(frames)
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1, keepdims=True), 0.0))
    # Free to spin: no twist held, no rest curvature, no direction of easier bending, no moment.
    spins = (stiff[:, 0, 2] == 0) & (stiff[:, -1, 2] == 0) & (rest[:, :, :2] == 0).all((1, 2))
    spins &= (stiff[:, :, 0] == stiff[:, :, 1]).all(1) & (moment == 0).all((1, 2))
    gauge = np.where(spins, stiff[:, 1:-1, 2].max(axis=1, initial=0.0), 0.0)
    rods = kernels.Rods(
        length, supple, stiff, np.concatenate([real, rest], -1), load, moment, gauge,
        np.ascontiguousarray(member, dtype=np.int64),
    )  # fmt: skip

    segments = length.shape[1]
    node, direction, offset, compliance = [], [], [], []
    if c.far_held:
        node.append(np.full(3, segments))
        direction.append(np.broadcast_to(np.eye(3), (frames, 3, 3)))
        offset.append(_numpy(c.ends[:, 1]))
        compliance.append(np.zeros((frames, 3)))
    active = np.ones((frames, 3 if c.far_held else 0), dtype=np.bool_)
    if c.node is not None:
        assert c.direction is not None
        assert c.offset is not None
        assert c.compliance is not None
        node.append(c.node)
        direction.append(_numpy(c.direction))
        offset.append(_numpy(c.offset))
        compliance.append(_numpy(c.compliance))
        more = np.ones((frames, len(c.node)), bool) if c.active is None else c.active
        active = np.concatenate([active, more], axis=1)
    clamp = _numpy(c.clamp)
    unheld = np.isnan(clamp).any(-1)
    if unheld.any():
        clamp = clamp.copy()
        clamp[unheld] = (1.0, 0.0, 0.0, 0.0)
    held = kernels.Frames(
        clamp,
        np.concatenate([*node, np.empty(0)]).astype(np.int64),
        np.concatenate([*direction, np.empty((frames, 0, 3))], axis=1),
        np.concatenate([*offset, np.empty((frames, 0))], axis=1),
        np.concatenate([*compliance, np.empty((frames, 0))], axis=1),
        np.ascontiguousarray(active),
        c.free,
    )
    return _Problem(rods, held)


def _cut(problem: _Problem, index: slice) -> tuple[kernels.Rods, kernels.Frames]:
    """The problem of some frames."""
    rods, f = problem
    return rods._replace(of=rods.of[index]), f._replace(
        clamp=f.clamp[index],
        direction=f.direction[index],
        offset=f.offset[index],
        compliance=f.compliance[index],
        active=f.active[index],
    )


def _or_zero(given: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    if given is None:
        return np.zeros(shape)
    return np.ascontiguousarray(np.broadcast_to(given, shape), dtype=np.float64)


def _numpy(t: Tensor) -> np.ndarray:
    return np.ascontiguousarray(t.detach().numpy(), dtype=np.float64)


def _in_threads(work: Callable[[slice], None], frames: int) -> None:
    """Call `work` on slices of the frames, one for each of torch's threads."""
    pieces = min(torch.get_num_threads(), frames // 8)
    if pieces <= 1:
        work(slice(0, frames))
        return
    bounds = [frames * k // pieces for k in range(pieces + 1)]
    with ThreadPoolExecutor(pieces) as pool:
        list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))
