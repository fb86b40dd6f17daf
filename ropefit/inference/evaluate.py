"""How well a simulation agrees with the data of the paper's losses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ropefit.losses.objectives import Scene
from ropefit.losses.primary import Observed, Residual, point_to_line


class Agreement(NamedTuple):
    """rms (F,) [m] and rms_px (F,) of point-to-line; residual (F, K) [m] at the segment
    boundaries."""

    rms: np.ndarray
    rms_px: np.ndarray
    residual: np.ndarray


def agreement(x: np.ndarray, scene: Scene) -> Agreement:
    """Compare ropes x (F, K, 3) with the data, arrays of numpy; NaN where a boundary was not
    seen."""
    space = point_to_line(x, scene.space)
    image = point_to_line(scene.camera.project(x), scene.image)
    goal, mask = scene.space.boundaries, scene.space.boundary_mask
    at_nodes = point_to_line(x, Observed(goal, mask, mask.astype(int), goal, mask))
    residual = np.linalg.norm(at_nodes.vectors, axis=-1)
    residual[~mask] = np.nan
    return Agreement(_rms(space), _rms(image), residual)


def _rms(residual: Residual) -> np.ndarray:
    square = np.where(residual.mask, (residual.vectors**2).sum(-1), 0.0).sum(-1)
    return np.sqrt(square / np.maximum(residual.mask.sum(-1), 1))
