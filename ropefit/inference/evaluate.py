"""How well a simulation agrees with the data, and how far its solver got."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.losses.objectives import Scene
from ropefit.losses.primary import Observed, point_to_line
from ropefit.models.xpbd import Rope
from ropefit.solvers.xpbd.reference import State

CHUNK = 500  # frames simulated at once: bounds memory on long recordings


class Agreement(NamedTuple):
    """rms (F,) [m] and rms_px (F,) of point-to-line; residual (F, K) [m] at the segment
    boundaries."""

    rms: np.ndarray
    rms_px: np.ndarray
    residual: np.ndarray


def agreement(x: Tensor, scene: Scene) -> Agreement:
    """Compare ropes x (F, K, 3) with the data, NaN where a boundary was not seen."""
    with torch.no_grad():
        space = point_to_line(x, scene.space)
        image = point_to_line(scene.camera.project(x), scene.image)
        goal, mask = scene.space.boundaries, scene.space.boundary_mask
        at_nodes = point_to_line(x, Observed(goal, mask, mask.long(), goal, mask))
    residual = at_nodes.vectors.norm(dim=-1).numpy().copy()
    residual[~mask.numpy()] = np.nan
    return Agreement(_rms(space), _rms(image), residual)


def _rms(residual) -> np.ndarray:
    square = torch.where(residual.mask, (residual.vectors**2).sum(-1), 0.0).sum(-1)
    return torch.sqrt(square / residual.mask.sum(-1).clamp_min(1)).numpy()


class Convergence(NamedTuple):
    """Along S sampled iterations: |C^D| max (F, S) [m], relative length error (F, S).

    drift (F,): largest move of a particle, over the rope's length, if iterated twice as long.
    """

    iteration: np.ndarray
    distance_violation: np.ndarray
    length_error: np.ndarray
    drift: np.ndarray


def settle_frames(rope: Rope, eta: Tensor) -> State:
    """Simulate all frames with eta (F, n)."""
    parts = []
    with torch.no_grad():
        for index in torch.split(torch.arange(len(eta)), CHUNK):
            parts.append(rope.frames(index).settle(eta[index]))
    return State(torch.cat([s.x for s in parts]), torch.cat([s.q for s in parts]))


def convergence(rope: Rope, eta: Tensor, final: Tensor, samples: int = 12) -> Convergence:
    """Return how the constraints stand along the iterations that lead to `final` (F, K, 3).

    The run is stopped within its first step and then after some of the steps, and once carried on
    with twice as many iterations.
    """
    whole = rope.settings
    inner = np.unique(np.geomspace(1, whole.iterations, 6).round().astype(int))
    outer = np.unique(np.geomspace(1, whole.steps, samples).round().astype(int))[1:]
    stops = [replace(whole, steps=1, iterations=int(n)) for n in inner]
    stops += [replace(whole, steps=int(n)) for n in outer]
    violation, error = [], []
    for stop in stops:
        done = stop == whole
        x = final if done else settle_frames(replace(rope, settings=stop), eta).x
        length = (x[:, 1:] - x[:, :-1]).norm(dim=-1)
        violation.append((length - rope.rest.length).abs().amax(-1))
        error.append(length.sum(-1) / rope.rest.length.sum() - 1)
    twice = replace(whole, iterations=2 * whole.iterations)
    longer = settle_frames(replace(rope, settings=twice), eta).x
    drift = (longer - final).norm(dim=-1).amax(-1) / rope.rest.length.sum()
    return Convergence(
        np.array([stop.total for stop in stops]),
        torch.stack(violation, 1).numpy(),
        torch.stack(error, 1).numpy(),
        drift.nan_to_num(torch.inf).clamp(max=1e3).numpy(),
    )
