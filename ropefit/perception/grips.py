"""A grip part-way along the rope: the rope between the grips is what is modelled.

A grip holds the rope's place and its direction there, so what hangs beyond it does not change the
shape between the grips: its weight and its bending moment go into the grip.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ropefit.perception.trace import FrameRejected, Trace, project_to_polyline, resample

AT_END = 1e-3  # of the length: a grip this close to the rope's end is at the end
OFF_ROPE = 0.05  # of the length: a traced rope that passes a grip by more is another
LEAST_GRIP = 0.01  # of the length between grips


@dataclass(frozen=True)
class Grips:
    """Arc lengths [m] of what is held at end 0 and end 1, on a rope of `whole` [m]."""

    first: float
    last: float
    whole: float

    @property
    def length(self) -> float:
        return self.last - self.first

    @property
    def part_way(self) -> np.ndarray:
        """Return (2,) which of the grips have rope beyond them."""
        slack = AT_END * self.whole
        return np.array([self.first > slack, self.last < self.whole - slack])

    def at_ends(self, poses: np.ndarray) -> np.ndarray:
        """Return poses (..., 2, D) of the rope's own ends: NaN where what is held is none."""
        return np.where(self.part_way[:, None], np.nan, poses)

    def between(self, trace: Trace, position: np.ndarray, material: bool) -> Trace:
        """Return a trace of the whole rope cut to what lies between the grips at position (2, 3)
        [m]. material: arc lengths are known, as of markers; else a grip is where the rope passes
        it. Raises FrameRejected."""
        own = np.array([self.first, self.last]) * trace.length / self.whole
        if not material:
            for end in np.flatnonzero(self.part_way & np.isfinite(position).all(axis=1)):
                place, off = project_to_polyline(position[[end]], trace.centreline)
                if np.linalg.norm(off) > OFF_ROPE * self.whole:
                    raise FrameRejected(f"the rope does not pass the grip of end {end}")
                own[end] = np.interp(place[0], np.arange(len(trace.arc)), trace.arc)
        if own[1] - own[0] < LEAST_GRIP * self.whole:
            raise FrameRejected("the grips coincide on the rope")
        scale = self.length / (own[1] - own[0])

        def cut(values: np.ndarray | None, arc: np.ndarray) -> np.ndarray | None:
            return None if values is None else values[(arc >= own[0]) & (arc <= own[1])]

        def shifted(arc: np.ndarray) -> np.ndarray:
            return (arc[(arc >= own[0]) & (arc <= own[1])] - own[0]) * scale

        inner = np.r_[own[0], cut(trace.arc, trace.arc), own[1]]
        pixel_arc = None if trace.pixel_arc is None else shifted(trace.pixel_arc)
        points = cut(trace.points, trace.point_arc)
        assert points is not None
        if len(points) < 2:
            raise FrameRejected("nothing of the rope between its grips is visible")
        return replace(
            trace, points=points, point_arc=shifted(trace.point_arc),
            centreline=resample(trace.centreline, trace.arc, inner), arc=shifted(inner),
            length=self.length, pixel_arc=pixel_arc,
            pixels=None if trace.pixel_arc is None else cut(trace.pixels, trace.pixel_arc),
            before=cut(trace.before, trace.point_arc),
            traced=trace.traced and trace.traced * (own[1] - own[0]) / trace.length,
        )  # fmt: skip
