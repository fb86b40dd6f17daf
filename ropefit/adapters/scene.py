"""From artifacts to the tensors that fits work on."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.artifacts import Observations
from ropefit.errors import BadInput, WrongUsage
from ropefit.losses.objectives import OBJECTIVES, Objective, Pinhole, Scene, objective
from ropefit.losses.primary import Observed
from ropefit.perception.camera import downwards


def _flat(loss: Objective) -> bool:
    """Return whether a loss compares nothing in space."""
    return loss.image and not loss.lowest


FLAT = tuple(name for name, loss in OBJECTIVES.items() if _flat(loss))


def pinhole(observations: Observations) -> Pinhole:
    """Return the view as tensors."""
    view = observations.view
    pose = torch.tensor(view.pose)
    return Pinhole(
        torch.tensor([view.fx, view.fy], dtype=torch.float64),
        torch.tensor([view.cx, view.cy], dtype=torch.float64),
        pose[:3, :3].clone(),
        pose[:3, 3].clone(),
    )


def check_loss(observations: Observations, loss: str) -> None:
    """Refuse a loss in space where nothing was measured in space. Raises WrongUsage."""
    if not observations.depth_measured and not _flat(objective(loss)):
        raise WrongUsage(
            f"{loss} compares points in space, but the recording has pictures without depth; use "
            f"--loss {', '.join(FLAT[:-1])} or {FLAT[-1]}"
        )


def build_scene(observations: Observations) -> Scene:
    """Return data of all frames, padded to the longest."""
    o = observations
    camera = pinhole(o)
    centreline = torch.tensor(o.centreline)
    mask = torch.isfinite(centreline).all(-1)
    depth = camera.depth(centreline.nan_to_num())
    # Mean depth of what was seen; the points stand in where no boundary was.
    points, point_mask, segment = _padded(o, o.points, o.point_arc, o.point_start)
    far = camera.depth(points)
    mean = torch.where(point_mask, far, 0.0).sum(1) / point_mask.sum(1)
    mean = torch.where(
        mask.any(1), torch.where(mask, depth, 0.0).sum(1) / mask.sum(1).clamp_min(1), mean
    )
    return Scene(
        space=Observed(points, point_mask, segment, centreline.nan_to_num(), mask),
        image=Observed(
            *_padded(o, o.pixels, o.pixel_arc, o.pixel_start),
            torch.tensor(o.centreline_px).nan_to_num(),
            torch.isfinite(torch.tensor(o.centreline_px)).all(-1),
        ),
        camera=camera,
        pixel_size=mean / camera.focal.mean(),
        lowest=torch.tensor(o.lowest),
        down=torch.from_numpy(downwards(o.gravity)),
    )


def _padded(
    o: Observations, values: np.ndarray, arc: np.ndarray, start: np.ndarray
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return (F, N, D) values, (F, N) mask, (F, N) segment index."""
    counts = np.diff(start)
    frames, most = len(counts), int(counts.max())
    out = np.zeros((frames, most, values.shape[1]))
    mask = np.arange(most) < counts[:, None]
    out[mask] = values
    segments = len(o.node_arc) - 1
    index = np.zeros((frames, most), dtype=np.int64)
    index[mask] = np.clip(np.floor(arc / o.length * segments), 0, segments - 1)
    return torch.from_numpy(out), torch.from_numpy(mask), torch.from_numpy(index)


def node_at(observations: Observations, control_at: float | None) -> int:
    """Return the particle nearest to an arc length [m]; end 0 when none is given."""
    if control_at is None:
        return 0
    if not 0 <= control_at <= observations.length:
        raise BadInput(
            f"control point at {control_at:g} m: the rope runs from 0 to {observations.length:g} m"
        )
    return int(np.argmin(np.abs(observations.node_arc - control_at)))


def control_positions(observations: Observations, node: int) -> np.ndarray:
    """Return (F, 3) [m] where the control point was: the recorded end, or the observed centreline
    there.

    NaN where it was not seen.
    """
    if node == 0:
        return observations.end_position[:, 0]
    if node == len(observations.node_arc) - 1:
        return observations.end_position[:, 1]
    return observations.centreline[:, node]
