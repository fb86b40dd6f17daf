"""Equilibria under forces that turn with the rope: Newton's method on those forces.

A force in the rope's own frame has no energy. Under the force as it was in the last state the rope
is at rest as under any load; how the frame that carries it answers to the load closes the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ropefit.rod.setup import Follower
from ropefit.solvers.equilibrium.solution import Solution, States
from ropefit.solvers.status import Status

ROUNDS = 25
STILL, SETTLED = 1e-9, 1e-6  # of the force: a change that ends the search, or is an equilibrium's
SHORTER, ENOUGH = 0.25, 0.1  # steps that bring the forces less nearer than that are shortened
MOST_SHORTENED = 3  # times, before a frame is given up: beyond a fold there is no equilibrium

Followers = tuple[Follower, ...]
Settle = Callable[[np.ndarray, States | None], Solution]  # under loads (F, N+1, 3) [N], from states
Response = Callable[[Solution, np.ndarray], tuple[np.ndarray, np.ndarray]]


def rotated(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) of the frames q (..., 4) in space."""
    w, axis = q[..., :1], q[..., 1:]
    across = np.cross(axis, v)
    return v + 2 * w * across + 2 * np.cross(axis, across)


def _carrying(follower: Follower) -> np.ndarray:
    """Return the segments whose frames carry a force: few of them."""
    return np.flatnonzero(follower.weight)


def in_space(followers: Followers, q: np.ndarray) -> np.ndarray:
    """Return (F, 3 m) [N] the m forces in space, carried by frames q (F, N, 4)."""
    forces = []
    for k in followers:
        at = _carrying(k)
        forces.append(np.einsum("n,fna->fa", k.weight[at], rotated(q[:, at], k.force)))
    return np.concatenate(forces, axis=1)


def on_nodes(followers: Followers, forces: np.ndarray) -> np.ndarray:
    """Return loads (F, N+1, 3) [N] of forces (F, 3 m) [N]."""
    parts = forces.reshape(len(forces), -1, 3)
    share = np.stack([k.share for k in followers])
    return np.einsum("kn,fka->fna", share, parts)


def loads(followers: Followers, q: np.ndarray, nodes: int) -> np.ndarray:
    """Return loads (F, N+1, 3) [N] of followers, perhaps none, carried by frames q (F, N, 4)."""
    if not followers:
        return np.zeros((len(q), nodes, 3))
    return on_nodes(followers, in_space(followers, q))


def turned(followers: Followers, q: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return (F, P, 3 m) changes of the forces by turns (F, P, N, 3) [rad] of the frames q about
    their own directors."""
    parts = []
    for k in followers:
        at = _carrying(k)
        moved = rotated(q[:, None, at], np.cross(turn[:, :, at], k.force))
        parts.append(np.einsum("n,fpna->fpa", k.weight[at], moved))
    return np.concatenate(parts, axis=-1)


def unit_loads(followers: Followers) -> np.ndarray:
    """Return (1, 3 m, N+1, 3) the loads of a unit of each component in space."""
    return np.stack([k.share[:, None] * np.eye(3)[a] for k in followers for a in range(3)])[None]


def closed(
    solution: Solution, dx: np.ndarray, turn: np.ndarray, dead: Response
) -> tuple[np.ndarray, np.ndarray]:
    """Return changes (F, P, N+1, 3) and turns (F, P, N, 3) under forces that follow, of those under
    forces that stay. dead: the response to loads (1, P, N+1, 3) that stay."""
    by, turning = dead(solution, unit_loads(solution.followers))
    loop = turned(solution.followers, solution.q, turning).swapaxes(1, 2)
    begun = turned(solution.followers, solution.q, turn).swapaxes(1, 2)
    forces = np.linalg.solve(np.eye(loop.shape[-1]) - loop, begun)
    dx = dx + np.einsum("fkp,fkna->fpna", forces, by)
    return dx, turn + np.einsum("fkp,fkna->fpna", forces, turning)


def _newton(found: Solution, followers: Followers, gap: np.ndarray, dead: Response) -> np.ndarray:
    """Return by what forces (F, 3 m) in space are to change, of which those of the frames that they
    lead to differ by `gap`."""
    _, turning = dead(found, unit_loads(followers))
    loop = turned(followers, found.q, turning).swapaxes(1, 2)
    return np.linalg.solve(np.eye(loop.shape[-1]) - loop, gap[..., None])[..., 0]


def solve_with_followers(
    settle: Settle, followers: Followers, start: States | None, dead: Response, every: bool = False
) -> Solution:
    """Return equilibria of F frames under forces that turn with the rope. Frames in which these do
    not come to rest are marked; every: all are, as soon as one of them is given up."""
    first = start if start is not None else settle(np.zeros(0), None)
    best = first.states if isinstance(first, Solution) else first.copy()
    held = in_space(followers, np.nan_to_num(first.q))
    size = max(float(np.linalg.norm(k.force)) for k in followers)
    least = np.full(len(held), np.inf)  # [N] how far the forces are from those of their frames
    step, share = np.zeros_like(held), np.ones(len(held))
    shortened = np.zeros(len(held), dtype=int)  # how often
    for _ in range(ROUNDS):
        forces = held + share[:, None] * step
        found = settle(on_nodes(followers, forces), best)
        gap = in_space(followers, found.q) - forces
        off = np.abs(gap).max(axis=1)
        off[~(found.converged & np.isfinite(off))] = np.inf
        better = off < (1 - ENOUGH * share) * least
        share, shortened = np.where(better, 1.0, SHORTER * share), shortened + ~better
        arrived = (off <= STILL * size) | (~better & (off <= SETTLED * size))
        lost = ~arrived & (shortened > MOST_SHORTENED)
        if every and lost.any():
            off[:] = np.inf
            break
        if (arrived | lost).all():
            break
        if not better.any():
            continue
        newton = _newton(found, followers, gap, dead)
        far = np.linalg.norm(newton, axis=1, keepdims=True) / size
        step[better] = (newton / np.maximum(far, 1.0))[better]
        held[better], least[better] = forces[better], off[better]
        best.put(better, found, better)
    late = found.converged & ~(off <= SETTLED * size)
    found.status[late] = Status.LIMIT
    return replace(found, followers=followers)


def pulled_through(
    solution: Solution, gx: np.ndarray, gq: np.ndarray, dead: Response
) -> np.ndarray:
    """Return the gradient (F, N, 4) in the frames with what the following forces add to it, of
    gradients gx (F, N+1, 3) in the nodes and gq (F, N, 4): the transpose of `closed`."""
    followers, q = solution.followers, solution.q
    by, turning = dead(solution, unit_loads(followers))
    loop = turned(followers, q, turning).swapaxes(1, 2)
    own = 0.5 * _imaginary(q, gq)
    begun = np.einsum("fkna,fna->fk", by, gx) + np.einsum("fkna,fna->fk", turning, own)
    forces = np.linalg.solve((np.eye(loop.shape[-1]) - loop).swapaxes(1, 2), begun[..., None])
    turn = np.zeros_like(own)
    for k, follower in enumerate(followers):
        # f = R(q) g changes by R (ω × g): its gradient in ω is g × Rᵀ λ.
        part = forces[:, 3 * k : 3 * k + 3, 0][:, None]
        back = rotated(q * np.array([1.0, -1.0, -1.0, -1.0]), np.broadcast_to(part, own.shape))
        turn += follower.weight[:, None] * np.cross(follower.force, back)
    w, v = q[..., :1], q[..., 1:]
    more = np.concatenate([-(v * turn).sum(-1, keepdims=True), w * turn + np.cross(v, turn)], -1)
    return gq + 2 * more


def _imaginary(q: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return the imaginary part (..., 3) of q* g."""
    w, v = q[..., :1], q[..., 1:]
    return w * g[..., 1:] - g[..., :1] * v - np.cross(v, g[..., 1:])
