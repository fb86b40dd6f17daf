"""Parameter identification of the paper: gradient or grid search over the η, one set or groups of
frames."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.inference import bfgs
from ropefit.inference.bfgs import Search
from ropefit.inference.sandwich import Uncertainty, sandwich, slopes_of
from ropefit.inference.search_space import Space
from ropefit.inference.starts import ranked
from ropefit.losses.objectives import Objective, Scene
from ropefit.models.rope import Rope
from ropefit.runs.journal import journal

SCREEN, SCREEN_FRAMES = 128, 6
STARTS = 3
TOLERANCE = 1e-4  # of a loss: its least relative decrease
MOST_NUDGED = 20  # candidates of a grid that are tried for stability
RACE = 8  # steps after which only the best start of a group goes on
# Particles simulated at once in a grid search, which bounds its memory (an accelerator: 2 GB).
CHUNK, CHUNK_ON_DEVICE = 40_000, 1_000_000
WIDTH = {"length": np.log(1.03)}  # how far around the start is screened, on a log scale
Report = Callable[[Search], None]


@dataclass(frozen=True)
class Task:
    """Fit `objective` of `rope` to `scene`; group (F,) says which parameter set each frame uses."""

    rope: Rope
    scene: Scene
    objective: Objective
    space: Space
    group: Tensor

    @property
    def groups(self) -> int:
        return int(self.group.max()) + 1

    def frames(self, index: Tensor) -> Task:
        return Task(
            self.rope.frames(index.numpy()),
            self.scene.frames(index),
            self.objective,
            self.space,
            self.group[index],
        )

    def loss(self, u: Tensor, rows: Tensor) -> Tensor:
        """Return (b,) loss [m] summed over the frames of each row's group, for u (b, m).

        Row r of a search belongs to group r // STARTS.
        """
        members = [torch.nonzero(self.group == int(row) // STARTS)[:, 0] for row in rows]
        owner = torch.repeat_interleave(torch.tensor([len(item) for item in members]))
        index = torch.cat(members)
        state = self.rope.frames(index.numpy()).settle(self.space.to_values(u)[owner])
        per_frame = self.frame_losses(state.x, self.scene.frames(index))
        return torch.zeros(len(rows), dtype=u.dtype).index_add(0, owner, per_frame)

    def frame_losses(self, x: Tensor, scene: Scene) -> Tensor:
        """Return (..., F) loss [m] of each frame, computed where the rope is settled."""
        device = self.rope.device
        if device is None:
            return self.objective.loss(x, scene)
        return self.objective.loss(x.to(device), scene.tensors(device)).cpu()


def gradient_search(
    task: Task,
    evaluations: int,
    report: Report | None = None,
) -> Search:
    """Minimise by BFGS, from the best of a coarse screen, by exact gradients; goes on from what the
    journal has kept.

    Returns one row a group: the best of STARTS searches.
    """
    name, search = bfgs.resumed(
        lambda own: bfgs.begin(task.loss, _screened_starts(task, f"{own}/screen"), reach=0.3)
    )
    while search.running and search.evaluations < evaluations:
        bfgs.step(task.loss, search, tolerance=TOLERANCE)
        if len(search.trace) > RACE:  # from here on only the leaders go on
            behind = torch.ones(len(search.u), dtype=torch.bool)
            behind[_leaders(search, task.groups)] = False
            search.status[behind & (search.status == bfgs.ACTIVE)] = bfgs.LIMIT
        journal().keep(name, lambda: bfgs.kept(search))
        if report:
            report(search)
    bfgs.stop_at_limit(search)
    return search.rows(_leaders(search, task.groups))


def _leaders(search: Search, groups: int) -> Tensor:
    """Return (groups,) the best row of each group."""
    best = ranked(search.loss.reshape(groups, STARTS).numpy(), 1)[:, 0]
    return torch.from_numpy(best) + STARTS * torch.arange(groups)


def _screened_starts(task: Task, name: str) -> Tensor:
    """Return (groups · STARTS, m) the best of the start and SCREEN points around it, by a few
    frames.

    Near the solver's limit of stability the loss is rough; a search that starts there stays.
    """
    m = len(task.space.free)
    few = [
        mine[torch.linspace(0, len(mine) - 1, min(SCREEN_FRAMES, len(mine))).long()]
        for mine in (torch.nonzero(task.group == g)[:, 0] for g in range(task.groups))
    ]
    start = task.space.to_search(np.tile(task.space.start, (task.groups, 1)))
    width = [_width(name) for name in task.space.free_names]
    points = torch.quasirandom.SobolEngine(m, scramble=False).draw(SCREEN, dtype=torch.float64)
    u = start[:, None, :] + torch.tensor(width, dtype=torch.float64) * (2 * points - 1)
    u = torch.cat([start[:, None, :], u], dim=1)
    losses = _grid_losses(task.frames(torch.cat(few)), u, name)
    order = torch.from_numpy(ranked(losses.numpy(), STARTS))
    return torch.gather(u, 1, order[:, :, None].expand(-1, -1, m)).reshape(-1, m)


def _width(name: str) -> float:
    wide = "_G" in name or name in ("EI", "GJ", "EA")
    return WIDTH.get(name, np.log(50.0) if wide else np.log(4.0))


def grid_search(
    task: Task,
    levels: int,
    rounds: int,
    report: Report | None = None,
) -> Search:
    """Search full factorial grids over the free parameters, each round half as wide around the best
    so far.

    levels a parameter; the first round spans one decade to each side of the start (within the
    bounds).
    """
    m, groups = len(task.space.free), task.groups
    start = task.space.to_search(np.tile(task.space.start, (groups, 1)))

    def begun(own: str) -> Search:
        loss = _grid_losses(task, start[:, None, :], f"{own}/start")[:, 0]
        return Search(
            start.clone(),
            loss,
            torch.zeros_like(start),
            torch.zeros(groups, m, m, dtype=start.dtype),
            torch.full((groups,), bfgs.ACTIVE),
            torch.zeros(groups, dtype=torch.int64),
            1,
            [loss.clone()],
        )

    name, search = bfgs.resumed(begun)
    offsets = torch.tensor(
        list(itertools.product(np.linspace(-1, 1, levels), repeat=m)), dtype=torch.float64
    )
    # A decade to each side, or the whole range of what has a narrow one.
    index = list(task.space.free)
    half = 0.5 * np.log(task.space.upper[index] / task.space.lower[index])
    offsets = offsets * torch.from_numpy(np.minimum(half, np.log(10.0)))
    for round_ in range(int(search.calm[0]), rounds):
        u = search.u[:, None, :] + 0.5**round_ * offsets
        losses = _grid_losses(task, u, f"{name}/{round_}").nan_to_num(torch.inf, torch.inf)
        best = _best_stable(task, u, losses)
        value = losses[torch.arange(groups), best]
        better = value < search.loss.nan_to_num(torch.inf)
        search.u[better] = u[torch.arange(groups), best][better]
        search.loss = torch.where(better, value, search.loss)
        search.evaluations += len(offsets)
        search.calm += 1
        search.trace.append(search.loss.clone())
        journal().keep(name, lambda: bfgs.kept(search))
        if report:
            report(search)
    finite = torch.isfinite(search.loss)
    search.status = torch.where(finite, bfgs.NO_DECREASE, bfgs.DIVERGED)
    return search


def _best_stable(task: Task, u: Tensor, losses: Tensor) -> Tensor:
    """Return (groups,) index of the best candidate that still converges when nudged up a little.

    The best of a grid may sit so near the solver's limit of stability that other frames diverge.
    """
    order = torch.from_numpy(ranked(losses.numpy(), MOST_NUDGED))
    chosen = order[:, 0].clone()
    for group in range(task.groups):
        for index in order[group]:
            near = u[group, index].expand(task.groups, 1, -1) + np.log(1.05)
            if torch.isfinite(_grid_losses(task, near)[group, 0]):
                chosen[group] = index
                break
    return chosen


def _grid_losses(task: Task, u: Tensor, name: str | None = None) -> Tensor:
    """Return (groups, candidates) losses for u (groups, candidates, m), in chunks of bounded
    memory, each kept in the journal under the name."""
    frames, nodes = task.rope.start.x.shape[:2]
    particles = CHUNK if task.rope.device is None else CHUNK_ON_DEVICE
    chunk = max(1, particles // (frames * nodes))
    out = []
    with torch.no_grad():
        for number, part in enumerate(torch.split(u, chunk, dim=1)):
            known = journal().recall(f"{name}/{number}") if name else None
            if known:
                out.append(torch.from_numpy(known["loss"]))
                continue
            values = task.space.to_values(part).transpose(0, 1)[:, task.group]  # (c, F, n)
            state = task.rope.settle(values)
            per_frame = task.frame_losses(state.x, task.scene)
            total = torch.zeros(len(values), task.groups, dtype=u.dtype)
            out.append(total.index_add(1, task.group, per_frame).T)
            if name:
                journal().keep(f"{name}/{number}", lambda: {"loss": out[-1].numpy()})
    return torch.cat(out, dim=1)


def uncertainty(task: Task, values: np.ndarray, floor: float, length: float) -> Uncertainty:
    """Return uncertainty of the free parameters (relative, i.e. of log p) of a task with one group.

    values (n,); central differences of the residual vectors, in one batch.
    """
    m, frames = len(task.space.free), len(task.group)
    step = task.rope.step
    candidates = np.tile(values, (2 * m + 1, 1))
    for k, index in enumerate(task.space.free):
        candidates[2 * k + 1, index] *= np.exp(step)
        candidates[2 * k + 2, index] *= np.exp(-step)
    with torch.no_grad():
        eta = torch.from_numpy(candidates)[:, None, :].expand(-1, frames, -1)
        state = task.rope.settle(eta)
        residuals = task.objective.residuals(state.x, task.scene)
    masks = [term.mask.numpy() for term in residuals]
    vectors = [t.vectors.numpy()[:, mask] for t, mask in zip(residuals, masks, strict=True)]
    cluster = np.concatenate([np.nonzero(mask)[0] for mask in masks])
    return sandwich(*slopes_of(vectors, step), cluster, floor=floor, dead_below=1e-9 * length)
