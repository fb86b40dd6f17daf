"""The bend elements of settled frames: what their memory works on, and how it moves."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.rod.quaternion import conjugate_product
from ropefit.rod.rod import Rod
from ropefit.solvers.conditions import Conditions, Sliders
from ropefit.solvers.equilibrium import Solution
from ropefit.solvers.turns import rolled


def vectors(rod: Rod, held: Conditions, solution: Solution) -> np.ndarray:
    """(N+1, 2) the vector parts of one frame's bend elements; zero where there is none."""
    return darboux(rod, held, solution)[:, 1:3]


def darboux(rod: Rod, held: Conditions, solution: Solution) -> np.ndarray:
    """(N+1, 4) the Darboux quaternions of one frame; zero where nothing is bent."""
    q, clamp = torch.from_numpy(solution.q[0]), torch.nan_to_num(held.clamp[0])
    around = torch.cat([clamp[:1], q, clamp[1:]])
    p = conjugate_product(around[:-1], around[1:]).numpy()
    rest = rod.rest.reshape(len(p), 3).numpy()
    real = np.sqrt(np.maximum(1 - (rest**2).sum(-1), 0.0))
    nearer = p[:, 0] * real + (p[:, 1:] * rest).sum(-1)
    stiff = rod.stiff.reshape(len(p), 3).numpy()
    sign = np.where(nearer < 0, -1.0, 1.0)
    return p * np.where(np.any(stiff > 0, axis=-1), sign, 0.0)[:, None]


def vector_change(p: np.ndarray, turns: np.ndarray, clamp: np.ndarray | None) -> np.ndarray:
    """(P, N+1, 2) change of the vectors of Darboux quaternions p (N+1, 4) when the frames turn by
    (P, N, 3), the clamps by clamp (P, 2, 3), each about its own axes."""
    ends = np.zeros((len(turns), 2, 3)) if clamp is None else clamp
    every = np.concatenate([ends[:, :1], turns, ends[:, 1:]], axis=1)
    low, high = every[:, :-1], every[:, 1:]
    moved = 0.5 * (p[:, :1] * (high - low) + np.cross(p[:, 1:], high + low))
    return moved[..., :2]


def spun(rod: Rod, held: Conditions, start: Solution, toward: np.ndarray) -> Solution:
    """A start whose frames are all spun alike, for its bends to lie as `toward` (N+1, 2) does."""
    out = start.copy()
    out.q[:] = rolled(start.q, vectors(rod, held, start)[None], toward[None])
    return out


def merged(
    parts: list[tuple[Rod, Conditions, Solution]],
) -> tuple[Rod, Conditions, Solution]:
    """Frames that were settled one by one as one: a support stands in all where it does in any."""
    rods = Rod(*(torch.cat(f) for f in zip(*(rod.each(1) for rod, _, _ in parts), strict=True)))
    held = [c for _, c, _ in parts]
    sliders = Sliders(*(np.concatenate(f) for f in zip(*(c.sliders for c in held), strict=True)))
    ends, clamp = (torch.cat([getattr(c, n) for c in held]) for n in ("ends", "clamp"))
    far = 3 if held[0].far_held else 0
    keys = [_numbered(c.node) for c in held]
    every = sorted(set().union(*keys))
    place = {key: k for k, key in enumerate(every)}
    frames, many = len(parts), len(every)
    direction = torch.zeros(frames, many, 3, dtype=torch.float64)
    offset = torch.zeros(frames, many, dtype=torch.float64)
    compliance = torch.ones(frames, many, dtype=torch.float64)
    active = np.zeros((frames, many), dtype=bool)
    reaction = np.zeros((frames, far + many))
    for t, (c, own) in enumerate(zip(held, keys, strict=True)):
        solution = parts[t][2]
        reaction[t, :far] = solution.reaction[0, :far]
        if c.node is None or not own:
            continue
        assert c.direction is not None
        assert c.offset is not None
        assert c.compliance is not None
        at = [place[key] for key in own]
        direction[t, at], offset[t, at] = c.direction[0], c.offset[0]
        compliance[t, at] = c.compliance[0]
        active[t, at] = True if c.active is None else c.active[0]
        known = min(solution.reaction.shape[1] - far, len(at))
        reaction[t, [far + k for k in at[:known]]] = solution.reaction[0, far : far + known]
    one = stacked([solution for _, _, solution in parts], reaction)
    if not every:
        return rods, Conditions(ends, clamp, sliders=sliders), one
    node = np.array([key[0] for key in every])
    return rods, Conditions(
        ends, clamp, node, direction, offset, compliance, active, sliders
    ), one  # fmt: skip


def _numbered(node: np.ndarray | None) -> list[tuple[int, int]]:
    """Supports as (node, which of that node's)."""
    out: list[tuple[int, int]] = []
    for k in [] if node is None else node.tolist():
        out.append((k, sum(other == k for other, _ in out)))
    return out


def stacked(parts: list[Solution], reaction: np.ndarray) -> Solution:
    """Solutions of one frame each as one, with these reactions."""
    fields = {
        name: np.concatenate([getattr(s, name) for s in parts])
        for name in Solution.__dataclass_fields__
        if name != "reaction"
    }
    return Solution(**fields, reaction=reaction)
