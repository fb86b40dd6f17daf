"""The fitted rope whose control point is to be found, and where a search for it sets out."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.adapters.gripped import gripped_rope
from ropefit.adapters.restore import restored_rope, within_reach
from ropefit.adapters.xpbd_model import moved_rope
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.errors import BadInput
from ropefit.models.rope import Rope


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
    o: Observations, model: FittedModel, position: np.ndarray, turns: bool,
    found: Diagnosis | None, moving: bool,
) -> tuple[Rope, torch.Tensor]:  # fmt: skip
    """Return the fitted rope, with what a diagnosis found, control point at `position` (F, 3) [m];
    values (F, n). moving: as it moves in the recording, where it was identified in motion."""
    position = np.where(np.isfinite(position), position, control_guess(o, model.control_node))
    if o.end_kind[0] == "free" and model.control_node == 0:
        raise BadInput("end 0 is free: there is no control point to estimate")
    if model.stepped is not None:
        return gripped_rope(o, model, position, turns, found, moving)
    if model.iterated is not None and not settles(o, model, found):
        rope, weights = moved_rope(o, model, position, turns)
        return rope, torch.from_numpy(weights)
    ends, end = o.end_position.copy(), 0 if model.control_node == 0 else 1
    ends[:, end] = position
    return restored_rope(o, model, within_reach(ends, end, _length(o, model)), turns, found)


def settles(o: Observations, model: FittedModel, found: Diagnosis | None) -> bool:
    """Return whether the rope is one in equilibrium: identified as that, or by the paper's solvers
    if something was found, which is beside such a rope. Their control point may lie inside it."""
    at_end = model.control_node in (0, len(o.node_arc) - 1)
    return model.iterated is None or (at_end and found is not None and bool(found.causes))


def _length(o: Observations, model: FittedModel) -> float:
    """Return [m] the least length that was fitted."""
    groups = [group.parameters.get("length") for group in model.groups.values()]
    return min((length.value for length in groups if length), default=o.length)
