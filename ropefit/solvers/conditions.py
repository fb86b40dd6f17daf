"""What holds a rope, and both as the compiled solver wants them: contiguous float64 arrays."""

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
from ropefit.solvers.shapes import check_problem


class Sliders(NamedTuple):
    """B springs at every bend element of F frames, between the vector part of its Darboux
    quaternion, about the first two directors, and centre (F, B, N+1, 2); of stiffness drag (F, B,
    N+1) [N m], with a force that no longer grows where they are longer than slip (F, B, N+1)."""

    drag: np.ndarray
    centre: np.ndarray
    slip: np.ndarray

    def frames(self, index: np.ndarray) -> Sliders:
        return Sliders(*(item[index] for item in self))


@dataclass(frozen=True)
class Conditions:
    """What holds the rope in F frames.

    ends (F, 2, 3) [m] and clamp (F, 2, 4), NaN where not held. More supports: node (S,),
    direction (F, S, 3), offset (F, S) [m], compliance (F, S) [m/N], active (F, S): the force λ on
    the node along the direction obeys direction · x + compliance λ = offset. sliders: what the
    past of a rope that remembers has left in it.
    """

    ends: Tensor
    clamp: Tensor
    node: np.ndarray | None = None
    direction: Tensor | None = None
    offset: Tensor | None = None
    compliance: Tensor | None = None
    active: np.ndarray | None = None
    sliders: Sliders | None = None

    @property
    def free(self) -> bool:
        """Nothing holds node 0."""
        return bool(torch.isnan(self.ends[:, 0]).any())

    @property
    def far_held(self) -> bool:
        return not bool(torch.isnan(self.ends[:, 1]).any())

    @property
    def far_supports(self) -> int:
        """How many of the supports hold the far end: 3, or 0 where it is free. They come first."""
        return 3 if self.far_held else 0

    @property
    def supports(self) -> int:
        """S, the far end's included."""
        return self.far_supports + (0 if self.node is None else len(self.node))

    def frames(self, index: Tensor | np.ndarray) -> Conditions:
        """The same for some of the frames."""
        index = torch.as_tensor(index)
        few = {
            name: value[index]
            for name in ("ends", "clamp", "direction", "offset", "compliance")
            if (value := getattr(self, name)) is not None
        }
        active = None if self.active is None else self.active[index.numpy()]
        sliders = None if self.sliders is None else self.sliders.frames(index.numpy())
        return replace(self, active=active, sliders=sliders, **few)


class Problem(NamedTuple):
    rods: kernels.Rods
    frames: kernels.Frames


def problem_of(rod: Rod, c: Conditions, member: np.ndarray | None) -> Problem:
    frames = len(c.ends)
    length, supple, stiff, rest, load, moment = (
        as_numpy(t if t.ndim == dim + 1 else t[None])
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
    if c.sliders is not None:
        turned = (c.sliders.drag[..., None] * c.sliders.centre != 0).any((1, 2, 3))
        spins &= ~turned if ropes == frames else ~turned.any()
    gauge = np.where(spins, stiff[:, 1:-1, 2].max(axis=1, initial=0.0), 0.0)
    rods = kernels.Rods(
        length, supple, stiff, np.concatenate([real, rest], -1), load, moment, gauge,
        np.ascontiguousarray(member, dtype=np.int64),
    )  # fmt: skip

    segments = length.shape[1]
    node, direction, offset, compliance = [], [], [], []
    far_held = c.far_held
    if far_held:
        node.append(np.full(3, segments))
        direction.append(np.broadcast_to(np.eye(3), (frames, 3, 3)))
        offset.append(as_numpy(c.ends[:, 1]))
        compliance.append(np.zeros((frames, 3)))
    active = np.ones((frames, 3 if far_held else 0), dtype=np.bool_)
    if c.node is not None:
        assert c.direction is not None
        assert c.offset is not None
        assert c.compliance is not None
        node.append(c.node)
        direction.append(as_numpy(c.direction))
        offset.append(as_numpy(c.offset))
        compliance.append(as_numpy(c.compliance))
        more = np.ones((frames, len(c.node)), bool) if c.active is None else c.active
        active = np.concatenate([active, more], axis=1)
    none = Sliders(
        np.zeros((frames, 0, segments + 1)),
        np.zeros((frames, 0, segments + 1, 2)),
        np.zeros((frames, 0, segments + 1)),
    )
    drag, centre, slip = c.sliders or none
    clamp = as_numpy(c.clamp)
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
        drag,
        centre,
        slip,
    )
    check_problem(rods, held)
    return Problem(rods, held)


def cut(problem: Problem, index: slice) -> tuple[kernels.Rods, kernels.Frames]:
    """The problem of some frames."""
    rods, f = problem
    return rods._replace(of=rods.of[index]), f._replace(
        clamp=f.clamp[index],
        direction=f.direction[index],
        offset=f.offset[index],
        compliance=f.compliance[index],
        active=f.active[index],
        drag=f.drag[index],
        centre=f.centre[index],
        slip=f.slip[index],
    )


def as_numpy(t: Tensor) -> np.ndarray:
    return np.ascontiguousarray(t.detach().numpy(), dtype=np.float64)


def in_threads(work: Callable[[slice], None], frames: int) -> None:
    """Call `work` on slices of the frames, one for each of torch's threads."""
    pieces = min(torch.get_num_threads(), frames // 8)
    if pieces <= 1:
        work(slice(0, frames))
        return
    bounds = [frames * k // pieces for k in range(pieces + 1)]
    with ThreadPoolExecutor(pieces) as pool:
        list(pool.map(work, [slice(a, b) for a, b in itertools.pairwise(bounds)]))
