"""How well a simulation agrees with the data of the paper's losses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ropefit.losses.objectives import Scene
from ropefit.losses.primary import Observed, point_to_line


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
