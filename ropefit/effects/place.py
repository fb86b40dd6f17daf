"""Places on the rope as weights of nodes and segments; in space, against gravity and the ends."""

from __future__ import annotations

import torch
from torch import Tensor

from ropefit.rod.setup import Setup


def at_point(arc: Tensor, place: Tensor) -> Tensor:
    """(K,) shares of the nodes, at arc (K,) [m], in something at `place` [m]; they sum to one."""
    length = (arc[1:] - arc[:-1]).detach()
    place = torch.minimum(torch.clamp(place, min=0.0), arc[-1].detach())
    index = int(torch.searchsorted(arc.detach(), place.detach(), right=True).clamp(1, len(arc) - 1))
    share = (place - arc[index - 1].detach()) / length[index - 1]
    out = torch.zeros_like(arc)
    left, right = torch.zeros_like(arc), torch.zeros_like(arc)
    left[index - 1], right[index] = 1.0, 1.0
    return out + (1 - share) * left + share * right


def over_interval(arc: Tensor, centre: Tensor, width: Tensor) -> Tensor:
    """(N,) fraction of each segment that lies within width/2 of the centre [m]."""
    arc = arc.detach()
    low = torch.maximum(arc[:-1], centre - width / 2)
    high = torch.minimum(arc[1:], centre + width / 2)
    return torch.clamp(high - low, min=0.0) / (arc[1:] - arc[:-1])


def horizontal(gravity: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors across gravity (3,), which follow it smoothly while it is tilted."""
    g = gravity.detach()
    size = g.norm()
    down = g / size if size > 0 else torch.tensor([0.0, 0.0, -1.0], dtype=g.dtype)
    axis = torch.zeros(3, dtype=g.dtype)
    axis[(int(down.abs().argmax()) + 1) % 3] = 1.0
    first = torch.linalg.cross(down, axis)
    first = first / first.norm()
    return first, torch.linalg.cross(down, first)


def middle_of(setup: Setup) -> Tensor:
    """(3,) mean of the held ends over all frames of the recording: an origin near the rope."""
    ends = setup.whole()[0].ends.detach().reshape(-1, 3)
    return ends[~torch.isnan(ends).any(-1)].mean(0)
