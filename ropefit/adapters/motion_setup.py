"""The rope between its grips, in motion: setup, data and where it was seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.adapters.end_path import end_path
from ropefit.adapters.motion_of import centrelines, clips_of, times_of
from ropefit.adapters.rope_setup import base_setup, data_in_space
from ropefit.artifacts import Observations
from ropefit.inference.bins import Data
from ropefit.rod.moving import Damping
from ropefit.rod.parallel_transport import continuous, third, unrolled
from ropefit.rod.setup import Setup

# With the error of the mesh extrapolated the first are enough for most ropes. Flexible ones bend
# next to a clamp within a few hundredths of their length.
SEGMENTS = (24, 48, 96)
PULLED = 12  # parts, between which a clip's first state is pulled to the observed rope
ON_LINE = 1e-6  # of a unit vector: a marker is the second of a held pair


@dataclass(frozen=True)
class Span:
    """What moves of a recording: arc length [m] of the innermost held points, its setup there, the
    data with shares of the span, and the observed rope (F, K, 3) [m] at arc (K,) [m]. twist [rad]:
    turn of the far clamp of a rope without twist, where the clamps' rolls are not seen."""

    first: float
    last: float
    setup: Setup
    data: Data
    arc: np.ndarray
    lines: np.ndarray
    twist: float | None = None

    @property
    def every(self) -> int:
        """Return the number of segments of a part that is pulled."""
        return self.setup.segments // PULLED

    @property
    def node_arc(self) -> np.ndarray:
        """Return (N+1,) [m] of the rod's nodes, in the recording's arc length."""
        return np.linspace(self.first, self.last, self.setup.segments + 1)


def span_of(o: Observations, segments: int = SEGMENTS[0]) -> Span:
    """Return the rope between its grips, a multiple of `PULLED` segments.

    Two held markers tell a clamp: the rope is free from the second on. Clamps whose twist is not
    seen are transported through each clip: they do not roll about the rope.
    """
    first, last = (_grip(o, end) for end in range(2))
    arc = np.linspace(first, last, PULLED + 1)
    lines = centrelines(o, arc)
    held = o.end_position.copy()
    for end, (place, inside) in enumerate(((0, first > 0), (-1, last < o.length))):
        # Poses that a recording tells are kept, as at rest: they may be late, or off.
        if np.isfinite(held[:, end]).all() and (inside or o.ends_assumed):
            held[:, end] = lines[:, place]
    # Frames in which a grip is not seen tell nothing of the rope.
    part = o.model_copy(
        update={
            "length": last - first,
            "mass": o.mass and o.mass * (last - first) / o.length,
            "end_position": held,
            "fittings": {
                name: piece.model_copy(update={"arc_length": piece.arc_length - first})
                for name, piece in o.fittings.items()
            },
        }
    )
    setup = base_setup(part, segments)
    clips, clamp = clips_of(times_of(o)), continuous(setup.clamp)
    clamp_compliance, twist = setup.clamp_compliance, None
    if not o.end_twist_known and all(setup.clamped):
        clamp, twist = unrolled(clamp, lines, clips)
        clamp_compliance = np.zeros_like(clamp_compliance)
    zero = np.zeros_like(setup.properties.length)
    setup = setup._replace(
        damping=Damping(zero, zero, zero, zero),
        motion=None,  # of the nodes: simulated, not observed
        end_path=end_path(o.time, o.frames, setup.ends, clamp, last - first),
        clamp=clamp,
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
        twist,
    )


def _grip(o: Observations, end: int) -> float:
    """Return [m] arc length from which the rope is free: of the second marker of a held pair, which
    lies on the clamp's own tangent in every frame."""
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
