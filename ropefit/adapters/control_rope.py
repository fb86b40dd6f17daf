"""The fitted rope whose control point is to be found, and where a search for it sets out."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.adapters.restore import restored_rope
from ropefit.adapters.xpbd_model import moved_rope
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.errors import BadInput
from ropefit.models.rope import Rope

REACH = 0.995  # of the length: how far apart the ends of a rope that does not stretch may start


def control_guess(o: Observations, node: int) -> np.ndarray:
    """Return (F, 3) [m] where the control point may be, from what is seen of the rope alone.

    The observed centreline, carried on straight beyond its first or last visible boundary. The
    recorded pose of the end is not used: it is what the estimate is judged by.
    """
    out = np.empty((len(o.frames), 3))
    for t, line in enumerate(o.centreline):
        seen = np.flatnonzero(np.isfinite(line).all(axis=1))
        arc, points = o.node_arc[seen], line[seen]
        if len(seen) < 2:
            first, last = o.point_start[t], o.point_start[t + 1]
            arc, points = o.point_arc[first:last], o.points[first:last]
        at = o.node_arc[node]
        if arc[0] <= at <= arc[-1]:
            out[t] = [np.interp(at, arc, column) for column in points.T]
            continue
        tip, inner = (0, 1) if at < arc[0] else (-1, -2)
        slope = (points[tip] - points[inner]) / max(abs(arc[tip] - arc[inner]), 1e-9)
        out[t] = points[tip] + slope * abs(at - arc[tip])
    return out


def rope_at(
    o: Observations, model: FittedModel, position: np.ndarray, turns: bool, found: Diagnosis | None
) -> tuple[Rope, torch.Tensor]:
    """Return the fitted rope, with what a diagnosis found, control point at `position` (F, 3) [m];
    values (F, n)."""
    position = np.where(np.isfinite(position), position, control_guess(o, model.control_node))
    if o.end_kind[0] == "free" and model.control_node == 0:
        raise BadInput("end 0 is free: there is no control point to estimate")
    if model.iterated is None:
        return restored_rope(o, model, _within_reach(o, model, position), turns, found)
    return moved_rope(o, model, position, turns)


def _within_reach(o: Observations, model: FittedModel, position: np.ndarray) -> np.ndarray:
    """Return (F, 2, 3) [m] the ends, the control point at `position`, but no farther off than the
    rope is long."""
    ends, end = o.end_position.copy(), 0 if model.control_node == 0 else 1
    ends[:, end] = position
    arm = ends[:, end] - ends[:, 1 - end]
    fitted = [g.parameters["length"].value for g in model.groups.values()]
    far = np.linalg.norm(arm, axis=1, keepdims=True) / (REACH * min(fitted))
    shorter = ends[:, 1 - end] + arm / np.fmax(far, 1.0)
    ends[:, end] = np.where(np.isfinite(arm), shorter, position)
    return ends
