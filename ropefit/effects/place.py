"""Places: on the rope as weights of nodes and segments, in space by gravity and the ends."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.rod.setup import Setup

SCAN_POINTS = 25  # places of a point effect along the rope
QUARTERS = (0, 25, 50, 75, 100)  # % of the length: where what varies along a whole rope is reported
SCAN_WIDTHS = (0.1, 0.2, 0.35, 0.6)  # of the length, of an interval effect

SPREAD = (torch.arange(16, dtype=torch.float64) + 0.5) / 16 - 0.5  # of a width: where it is summed


def points_along(setup: Setup) -> np.ndarray:
    """Return (Q, 1) arc lengths [m] at which a scan tries a point effect."""
    length = float(setup.properties.length.sum())
    return _tried(setup, (np.linspace(0.02, 0.98, SCAN_POINTS) * length)[:, None])


def intervals_along(setup: Setup) -> np.ndarray:
    """Return (Q, 2) centres and widths [m] at which a scan tries an interval effect."""
    length = float(setup.properties.length.sum())
    every = [
        (c * length, w * length)
        for w in SCAN_WIDTHS
        for c in np.linspace(w / 2, 1 - w / 2, round(2.0 / w))
    ]
    return _tried(setup, np.array(every))


def _tried(setup: Setup, places: np.ndarray) -> np.ndarray:
    """Return every place of a rope at rest, every second of one in motion, where each is a
    simulation."""
    return places if setup.damping is None else places[::2]


def at_point(arc: Tensor, place: Tensor) -> Tensor:
    """Return (K,) shares of the nodes, at arc (K,) [m], in a point at `place` [m]; the sum is 1."""
    length = (arc[1:] - arc[:-1]).detach()
    place = torch.minimum(torch.clamp(place, min=0.0), arc[-1].detach())
    index = int(torch.searchsorted(arc.detach(), place.detach(), right=True).clamp(1, len(arc) - 1))
    share = (place - arc[index - 1].detach()) / length[index - 1]
    out = torch.zeros_like(arc)
    left, right = torch.zeros_like(arc), torch.zeros_like(arc)
    left[index - 1], right[index] = 1.0, 1.0
    return out + (1 - share) * left + share * right


def around_point(arc: Tensor, place: Tensor, width: Tensor) -> Tensor:
    """Return (K,) shares of the nodes in something spread evenly over `width` [m] about a place.

    Cubic interpolation: the shares have the moments of the spread up to the third, so that neither
    the place between two nodes nor a width below a segment is lost. The sum is 1.
    """
    arc = arc.detach()
    at = torch.clamp(place + width * SPREAD, min=0.0)
    at = torch.minimum(at, arc[-1])
    low = (torch.searchsorted(arc, at.detach(), right=True) - 2).clamp(0, len(arc) - 4)
    index = low[:, None] + torch.arange(4)
    node = arc[index]  # (S, 4)
    other = ~torch.eye(4, dtype=torch.bool)
    steps = (at[:, None, None] - node[:, None, :]) / torch.where(
        other, node[:, :, None] - node[:, None, :], 1.0
    )
    share = torch.where(other, steps, 1.0).prod(-1) / len(at)
    return torch.zeros_like(arc).index_add(0, index.reshape(-1), share.reshape(-1))


def over_interval(arc: Tensor, centre: Tensor, width: Tensor) -> Tensor:
    """Return (N,) the fraction of each segment that lies within width/2 of the centre [m]."""
    arc = arc.detach()
    low = torch.maximum(arc[:-1], centre - width / 2)
    high = torch.minimum(arc[1:], centre + width / 2)
    return torch.clamp(high - low, min=0.0) / (arc[1:] - arc[:-1])


def nearest_node(setup: Setup, place: float, nodes: int) -> int:
    """Return the index of the node nearest to arc length `place` [m], of evenly spaced nodes."""
    return round(place / float(setup.properties.length.sum()) * (nodes - 1))


def horizontal(gravity: Tensor) -> tuple[Tensor, Tensor]:
    """Return two horizontal unit vectors, which follow gravity (3,) smoothly while it is tilted."""
    g = gravity.detach()
    size = g.norm()
    down = g / size if size > 0 else torch.tensor([0.0, 0.0, -1.0], dtype=g.dtype)
    axis = torch.zeros(3, dtype=g.dtype)
    axis[(int(down.abs().argmax()) + 1) % 3] = 1.0
    first = torch.linalg.cross(down, axis)
    first = first / first.norm()
    return first, torch.linalg.cross(down, first)


def middle_of(setup: Setup) -> Tensor:
    """Return (3,) the mean of the held ends over all frames: an origin near the rope."""
    ends = setup.whole()[0].ends.detach().reshape(-1, 3)
    return ends[~torch.isnan(ends).any(-1)].mean(0)


def between_quarters(setup: Setup) -> Tensor:
    """Return (N, 5) how much every segment has of what is reported at each of `QUARTERS`."""
    length = setup.properties.length
    share = (setup.arc[1:] - 0.5 * length) / length.sum()
    places = 0.01 * torch.tensor(QUARTERS, dtype=torch.float64)
    return torch.clamp(1 - (share[:, None] - places).abs() / (places[1] - places[0]), min=0)
