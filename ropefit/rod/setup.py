"""Everything that decides what a recording shows: the rope, what holds it, and how it is seen.

Parameters, calibration errors and effects all act on this one picture; see `effects/`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ropefit.rod.rod import Properties, Rod, build


class Seen(NamedTuple):
    """Small errors of the sensor: rotation (3,) [rad] and gain about its place (3,), shift (3,)
    [m], depth [m] along its rays. A point p is reported at
    p + rotation x (p - place) + gain (p - place) + shift + depth (p - place)/|p - place|."""

    place: Tensor
    rotation: Tensor
    gain: Tensor
    shift: Tensor
    depth: Tensor

    def __call__(self, x: Tensor) -> Tensor:
        """(..., 3) where points x (..., 3) [m] are reported."""
        arm = x - self.place
        ray = arm / torch.linalg.norm(arm, dim=-1, keepdim=True)
        turned = torch.linalg.cross(self.rotation.expand_as(arm), arm)
        return x + turned + self.gain * arm + self.shift + self.depth * ray


class Potential(NamedTuple):
    """An energy [J] of single nodes: energy(x (..., 3)) -> (...,), times share (N+1,) per node.

    Smooth, or with a corner in its slope (contact); `smooth` is the width [m] of that corner.
    """

    energy: Callable[[Tensor], Tensor]
    share: Tensor


class Setup(NamedTuple):
    """F frames of one rope of N segments.

    properties: see `Properties`; gravity (3,) [m/s²]; load (N+1, 3) [N]; moment (2, 3) [N m];
    give (2, 2) [rad/(N m)] of the clamps; kinks (N+1, 3) [rad]; ends (F, 2, 3) [m], clamp
    (F, 2, 4), NaN where not held; clamped: whether each end is; seen; potentials.
    """

    properties: Properties
    gravity: Tensor
    load: Tensor
    moment: Tensor
    give: Tensor
    kinks: Tensor
    ends: Tensor
    clamp: Tensor
    clamped: tuple[bool, bool]
    seen: Seen
    potentials: tuple[Potential, ...] = ()

    @property
    def segments(self) -> int:
        return self.load.shape[-2] - 1

    @property
    def arc(self) -> Tensor:
        """(N+1,) [m] rest arc length of the nodes."""
        return torch.nn.functional.pad(self.properties.length.cumsum(-1), (1, 0))

    def rod(self) -> Rod:
        """The discrete rod with all its loads."""
        rod = build(self.properties, self.gravity, self.clamped, self.give, self.kinks)
        return rod._replace(load=rod.load + self.load, moment=rod.moment + self.moment)


def bare(
    properties: Properties,
    gravity: Tensor,
    ends: Tensor,
    clamp: Tensor,
    viewpoint: Tensor,
) -> Setup:
    """The setup without any effect. Shapes as in `Setup`; viewpoint (3,) [m]."""
    segments = properties.length.shape[-1]
    zero = torch.zeros(3, dtype=torch.float64)
    held = ~torch.isnan(clamp).any(-1).any(0)
    return Setup(
        properties=properties,
        gravity=gravity,
        load=torch.zeros(segments + 1, 3, dtype=torch.float64),
        moment=torch.zeros(2, 3, dtype=torch.float64),
        give=torch.zeros(2, 2, dtype=torch.float64),
        kinks=torch.zeros(segments + 1, 3, dtype=torch.float64),
        ends=ends,
        clamp=clamp,
        clamped=(bool(held[0]), bool(held[1])),
        seen=Seen(viewpoint, zero, zero[0], zero, zero[0]),
    )
