"""How well a simulation agrees with the data, and how far its solver got."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.inference.rope import Rope
from ropefit.losses.objectives import Scene
from ropefit.losses.primary import Observed, point_to_line
from ropefit.solvers.xpbd import State

CHUNK = 60  # frames simulated at once: bounds memory on long recordings


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


def settle_frames(rope: Rope, eta: Tensor, samples: int = 24) -> tuple[State, Convergence]:
    """Simulate all frames (eta (F, n)) and watch the solver."""
    total = rope.settings.total
    wanted = np.unique(np.geomspace(1, total, samples).round().astype(int))
    states, violations, errors, drifts = [], [], [], []
    for index in torch.split(torch.arange(len(eta)), CHUNK):
        part, weights = rope.frames(index), eta[index]
        violation, error = [], []

        def watch(iteration: int, x: Tensor, q: Tensor, violation=violation, error=error) -> None:
            if iteration in wanted:
                length = (x[:, 1:] - x[:, :-1]).norm(dim=-1)
                violation.append((length - rope.rest.length).abs().amax(-1))
                error.append(length.sum(-1) / rope.rest.length.sum() - 1)

        with torch.no_grad():
            state = part.settle(weights, watch=watch)
            longer = part.settle(weights, longer=2)
        states.append(state)
        violations.append(torch.stack(violation, 1))
        errors.append(torch.stack(error, 1))
        moved = (longer.x - state.x).norm(dim=-1).amax(-1)
        drifts.append(moved / rope.rest.length.sum())
    state = State(torch.cat([s.x for s in states]), torch.cat([s.q for s in states]))
    return state, Convergence(
        wanted,
        torch.cat(violations).numpy(),
        torch.cat(errors).numpy(),
        torch.cat(drifts).numpy(),
    )
