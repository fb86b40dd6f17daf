"""From artifacts to the arrays that the paper's losses work on."""

from __future__ import annotations

import numpy as np

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
    """Return the camera of the view."""
    view = observations.view
    return Pinhole(
        np.array([view.fx, view.fy]),
        np.array([view.cx, view.cy]),
        view.pose[:3, :3],
        view.pose[:3, 3],
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
    mask = np.all(np.isfinite(o.centreline), axis=-1)
    centreline = np.nan_to_num(o.centreline)
    points, point_mask, segment = _padded(o, o.points, o.point_arc, o.point_start)
    # Mean depth of what was seen; the points stand in where no boundary was.
    depth = _mean(camera.depth(centreline), mask)
    depth = np.where(np.isnan(depth), _mean(camera.depth(points), point_mask), depth)
    return Scene(
        space=Observed(points, point_mask, segment, centreline, mask),
        image=Observed(
            *_padded(o, o.pixels, o.pixel_arc, o.pixel_start),
            np.nan_to_num(o.centreline_px),
            np.isfinite(o.centreline_px).all(-1),
        ),
        camera=camera,
        pixel_size=depth / camera.focal.mean(),
        lowest=o.lowest,
        down=downwards(o.gravity),
    )


def _mean(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return (F,) mean of those of the values (F, N) that count, NaN where none does."""
    with np.errstate(invalid="ignore"):
        return np.where(mask, values, 0.0).sum(1) / mask.sum(1)


def _padded(
    o: Observations, values: np.ndarray, arc: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (F, N, D) values, (F, N) mask, (F, N) segment index."""
    counts = np.diff(start)
    frames, most = len(counts), int(counts.max())
    out = np.zeros((frames, most, values.shape[1]))
    mask = np.arange(most) < counts[:, None]
    out[mask] = values
    segments = len(o.node_arc) - 1
    index = np.zeros((frames, most), dtype=np.int64)
    index[mask] = np.clip(np.floor(arc / o.length * segments), 0, segments - 1)
    return out, mask, index


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
