"""The rope between its grips, in motion: setup, data and where it was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from ropefit.adapters.motion_of import centrelines, clips_of, rates
from ropefit.adapters.rope_setup import base_setup, data_in_space
from ropefit.artifacts import Observations
from ropefit.inference.bins import Data
from ropefit.rod.carried import carried, continuous, third
from ropefit.rod.moving import Damping
from ropefit.rod.setup import Motion, Setup
from ropefit.solvers.equilibrium.turns import to_turn

SEGMENTS = 48  # with 24 a soft rope comes out some 5 % too stiff
EVERY = 4  # nodes between which a clip's first state is pulled to the observed rope
ON_LINE = 1e-6  # of a unit vector: a marker is the second of a held pair


@dataclass(frozen=True)
class Span:
    """What moves of a recording: arc length [m] of the innermost held points, its setup there, the
    data with shares of the span, and the observed rope (F, K, 3) [m] at arc (K,) [m]."""

    first: float
    last: float
    setup: Setup
    data: Data
    arc: np.ndarray
    lines: np.ndarray

    @property
    def node_arc(self) -> np.ndarray:
        """(N+1,) [m] of the rod's nodes, in the recording's arc length."""
        return np.linspace(self.first, self.last, SEGMENTS + 1)


def span_of(o: Observations) -> Span:
    """The rope between its grips.

    Two held markers tell a clamp: the rope is free from the second on. Clamps whose twist is not
    seen are carried along: they do not roll about the rope.
    """
    first, last = (_grip(o, end) for end in range(2))
    arc = np.linspace(first, last, SEGMENTS // EVERY + 1)
    lines = centrelines(o, arc)
    held = o.end_position.copy()
    for end, place in ((0, 0), (1, -1)):
        if np.isfinite(held[:, end]).all():
            held[:, end] = lines[:, place]
    # Frames in which a grip is not seen tell nothing of the rope.
    part = o.model_copy(update={"length": last - first, "end_position": held})
    setup = base_setup(part, SEGMENTS)
    clips, clamp = clips_of(o.time), continuous(setup.clamp.numpy())
    clamp_compliance = setup.clamp_compliance
    if not o.end_twist_known and all(setup.clamped):
        clamp, clamp_compliance = carried(clamp, lines, clips), torch.zeros_like(clamp_compliance)
    zero = torch.zeros_like(setup.properties.length)
    setup = setup._replace(
        damping=Damping(zero, zero, zero, zero),
        motion=_motion_of_ends(o, setup, clamp, clips),
        clamp=torch.from_numpy(clamp),
        clamp_compliance=clamp_compliance,
    )
    data = data_in_space(o)
    share = (data.share * o.length - first) / (last - first)
    mask = data.mask & (share > 0) & (share < 1)
    return Span(
        first,
        last,
        setup,
        replace(data, share=share, mask=mask),
        arc,
        lines,
    )


def _motion_of_ends(
    o: Observations, setup: Setup, clamp: np.ndarray, clips: list[np.ndarray]
) -> Motion:
    """Return how the ends move; the motion of the nodes is simulated, not observed."""
    velocity, acceleration = rates(o.time, np.nan_to_num(setup.ends.numpy()), clips)
    turning = to_turn(np.nan_to_num(clamp), rates(o.time, np.nan_to_num(clamp), clips)[0], 2.0)
    nothing = torch.zeros(len(o.frames), 1, 3, dtype=torch.float64)
    return Motion(nothing, nothing, *map(torch.from_numpy, (velocity, acceleration, turning)))


def _grip(o: Observations, end: int) -> float:
    """[m] arc length from which the rope is free: of the second marker of a held pair, which lies
    on the clamp's own tangent in every frame."""
    own = 0.0 if end == 0 else o.length
    if o.end_twist_known or o.source != "markers" or o.end_kind[end] != "clamped":
        return own
    tangent, count = third(o.end_orientation[:, end]), np.diff(o.point_start)
    place = 1 if end == 0 else -2
    rows = o.point_start[:-1] + place if end == 0 else o.point_start[1:] + place
    if count.min() < 3:
        return own
    gap = (o.points[rows] - o.end_position[:, end]) * (1 if end == 0 else -1)
    gap /= np.linalg.norm(gap, axis=1, keepdims=True)
    on_line = np.abs(gap - tangent).max() < ON_LINE
    return float(o.point_arc[rows[0]]) if on_line else own
