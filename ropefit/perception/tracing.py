"""Trace any frame of a recording, whatever its sensor, with what is known of the ends."""

from __future__ import annotations

import numpy as np

from ropefit.errors import BadInput
from ropefit.perception.camera import Camera, virtual_camera
from ropefit.perception.cloud import trace_cloud
from ropefit.perception.markers import marker_arc, marker_noise, trace_markers
from ropefit.perception.trace import FrameRejected, Trace
from ropefit.recordings import Recording, check_spread

SLACK = 1.02  # ends farther apart than this times the length contradict the recording


class Tracer:
    """Holds what is the same for all frames: ends, length, camera, marker arc lengths."""

    def __init__(self, recording: Recording, most_points: int = 400):
        self.recording = recording
        self.most_points = most_points
        rope = recording.manifest.rope
        self.length = rope.length
        self.radius = rope.diameter / 2 if rope.diameter else None
        self.end_kind = (
            (recording.ends[0].kind, recording.ends[1].kind)
            if recording.ends
            else ("pinned", "pinned")
        )
        if self.end_kind == ("free", "free"):
            raise BadInput(f"{recording.path}: both ends are free; at least one must be held")
        self.camera = self._camera()
        self.noise: float | None = None
        self.noise_source = "scatter of the points about the centreline"
        if recording.source.table == "markers":
            self._prepare_markers()

    def ends(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions (2, 3) [m] and orientations (2, 4) of a frame; NaN where not held."""
        position, orientation = np.full((2, 3), np.nan), np.full((2, 4), np.nan)
        for end, rows in enumerate(self.recording.ends or ()):
            if rows.kind == "free":
                continue
            if frame not in rows.position:
                raise FrameRejected(f"end {end} has no pose")
            position[end] = rows.position[frame]
            if rows.kind == "clamped":
                orientation[end] = rows.orientation[frame]
        apart = np.linalg.norm(position[1] - position[0])
        if self.length and apart > SLACK * self.length:
            raise BadInput(
                f"{self.recording.path}: frame {frame}: the ends are {apart:.4g} m apart but the "
                f"rope is {self.length:.4g} m long; correct [rope] length or the ends (metres?)"
            )
        return position, orientation

    def trace(self, frame: int) -> Trace:
        """One frame. Raises FrameRejected with the reason."""
        position, orientation = self.ends(frame)
        sight = self.recording.source.sight(frame)
        if sight.ordered:
            assert sight.points is not None
            return trace_markers(
                sight.points, self.arc, self.total, position, tangents(orientation)
            )
        if sight.points is not None:
            return trace_cloud(
                sight.points,
                position,
                self.length,
                self.radius,
                self._viewpoint(),
                most=self.most_points,
            )
        from ropefit.perception.rgbd import trace_rgbd

        assert sight.color is not None
        assert self.camera is not None
        if sight.depth is None:
            raise BadInput(
                f"{self.recording.path}: [rgbd] has no depth and there are no clouds or markers; "
                "3D data are needed: add `depth`"
            )
        trace, _ = trace_rgbd(
            sight.color, sight.depth, self.camera, position, self.length, self.radius
        )
        check_spread(self.recording.path, frame, trace.points, self.length)
        return trace

    def view(self, points: np.ndarray) -> Camera:
        """The recording's camera, or a virtual one that sees points (N, 3)."""
        return self.camera or virtual_camera(points, self.recording.gravity, self._viewpoint())

    def _viewpoint(self) -> np.ndarray | None:
        clouds = self.recording.manifest.clouds
        return np.array(clouds.viewpoint) if clouds and clouds.viewpoint else None

    def _camera(self) -> Camera | None:
        rgbd = self.recording.manifest.rgbd
        if rgbd is None:
            return None
        k = rgbd.intrinsics
        return Camera(k.width, k.height, k.fx, k.fy, k.cx, k.cy, np.array(rgbd.camera_pose))

    def _prepare_markers(self) -> None:
        frames = self.recording.frames
        points = [self.recording.source.sight(frame) for frame in frames]
        positions = np.stack([sight.points for sight in points])  # type: ignore[arg-type]
        ends = np.full((len(frames), 2, 3), np.nan)
        for t, frame in enumerate(frames):
            for end, rows in enumerate(self.recording.ends or ()):
                ends[t, end] = rows.position.get(frame, np.full(3, np.nan))
        known = points[0].arc_length
        if known is not None:
            self.arc = known
            self.total = self.length or float(known[-1])
            if known[-1] > self.total * (1 + 1e-6):
                raise BadInput(
                    f"{self.recording.path}: arc_length reaches {known[-1]:g} m beyond the rope's "
                    f"length {self.total:g} m"
                )
        else:
            try:
                self.arc, self.total = marker_arc(positions, ends, self.length)
            except FrameRejected as reason:
                raise BadInput(f"{self.recording.path}: [markers]: {reason}")
        time = np.array([self.recording.source.time[frame] for frame in frames])
        self.noise, self.noise_source = marker_noise(positions, time)


def tangents(orientation: np.ndarray) -> np.ndarray:
    """(..., 3) third directors of quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(orientation, -1, 0)
    return np.stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=-1
    )
