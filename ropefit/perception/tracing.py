"""Trace any frame of a recording, whatever its sensor, with what is known of the ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ropefit.errors import BadInput
from ropefit.perception import checks
from ropefit.perception.camera import Camera, virtual_camera
from ropefit.perception.cloud import trace_cloud
from ropefit.perception.grips import Grips
from ropefit.perception.jumps import jumps
from ropefit.perception.learning import Picture, best_looks
from ropefit.perception.lost_frames import lost_frames
from ropefit.perception.markers import marker_arc, marker_noise, trace_markers
from ropefit.perception.segment import LARGE_PICTURE, Looked, Segmentation
from ropefit.perception.trace import FrameRejected, Trace
from ropefit.recordings import Masks, Recording, check_spread

Look = Callable[[int, np.ndarray, np.ndarray | None, Trace, Segmentation], None]  # see Album.look
LEARN_FROM = 3  # frames in which the rope is looked for by all cues
SLACK = 1.02  # ends farther apart than this times the length contradict the recording


class Tracer:
    """Holds what is the same for all frames: ends, length, camera, marker arc lengths."""

    def __init__(
        self,
        recording: Recording,
        most_points: int = 400,
        looked: Looked | None = None,
        masks: Masks | None = None,
    ):
        self.recording = recording
        self.looked = looked or Looked()
        self.masks = masks
        self.most_points = most_points
        rope = recording.manifest.rope
        self.length = rope.length
        self.radius = rope.diameter / 2 if rope.diameter else None
        self.grips = self._grips()
        self.end_kind = (
            (recording.ends[0].kind, recording.ends[1].kind)
            if recording.ends
            else ("pinned", "pinned")
        )
        if self.end_kind == ("free", "free"):
            raise BadInput(f"{recording.path}: both ends are free; at least one must be held")
        self.camera = self._camera()
        self.several: set[int] = set()  # frames in which more than one rope was seen
        self.jumped: dict[int, np.ndarray] = {}  # {frame: (M,) bool} markers that are masked
        self.warnings: list[str] = []  # what will mislead a fit
        self.noise: float | None = None
        self.noise_known = self.measures_depth  # neither assumed nor an upper bound
        self.noise_source = "scatter of the points about the centreline"
        if not self.measures_depth:
            self.noise_source = "assumed: half a pixel, on the assumed plane"
        if recording.source.table == "markers":
            self._prepare_markers()
        ends, clamps = self._all_ends()
        self.warnings += checks.ends_apart(recording.frames, ends, self.span)
        self.warnings += checks.one_end_pose(ends, clamps)

    @property
    def span(self) -> float | None:
        """Return [m] of rope between what is held, if known."""
        return self.grips.length if self.grips is not None else self.length

    def ends(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (2, 3) [m] and orientations (2, 4) of a frame; NaN where not held."""
        position, orientation = np.full((2, 3), np.nan), np.full((2, 4), np.nan)
        for end, rows in enumerate(self.recording.ends or ()):
            if rows.kind == "free":
                continue
            if frame not in rows.position:
                raise FrameRejected(f"end {end} has no pose")
            if self._held_jumps(end, frame):
                raise FrameRejected(f"the marker held at end {end} jumps")
            position[end] = rows.position[frame]
            if rows.kind == "clamped":
                orientation[end] = rows.orientation[frame]
        apart = np.linalg.norm(position[1] - position[0])
        if self.span and apart > SLACK * self.span:
            raise BadInput(
                f"{self.recording.path}: frame {frame}: the ends are {apart:.4g} m apart but the "
                f"rope is {self.span:.4g} m long; correct [rope] length or the ends (metres?)"
            )
        return position, orientation

    def trace(self, frame: int, look: Look | None = None) -> Trace:
        """Trace one frame; look(frame, color, depth, trace, found) is shown what pictures hold.
        Raises FrameRejected with the reason."""
        position, orientation = self.ends(frame)
        if self.grips is None:
            return self._whole(frame, position, orientation, look)
        own = [self.grips.at_ends(pose) for pose in (position, orientation)]
        whole = self._whole(frame, own[0], own[1], look)
        return self.grips.between(whole, position, self.recording.source.table == "markers")

    def _whole(
        self, frame: int, position: np.ndarray, orientation: np.ndarray, look: Look | None
    ) -> Trace:
        """Trace the whole rope, with its own ends (2, 3) [m] and (2, 4), NaN where not held."""
        sight = self.recording.source.sight(frame)
        if sight.ordered:
            assert sight.points is not None
            points = np.where(self.jumped[frame][:, None], np.nan, sight.points)
            return trace_markers(points, self.arc, self.total, position, tangents(orientation))
        if sight.points is not None:
            return trace_cloud(
                sight.points,
                position,
                self.length,
                self.radius,
                self._viewpoint(),
                most=self.most_points,
            )
        assert sight.color is not None
        trace, found = self.trace_picture(frame, sight.color, sight.depth, position)
        if look is not None:
            look(frame, sight.color, sight.depth, trace, found)
        return trace

    def trace_picture(
        self, frame: int, color: np.ndarray, depth: np.ndarray | None, position: np.ndarray
    ) -> tuple[Trace, Segmentation]:
        """Return a frame of pictures, and what was taken for the rope in it. Raises
        FrameRejected."""
        from ropefit.perception.image import trace_image
        from ropefit.perception.rgbd import trace_rgbd

        assert self.camera is not None
        looked = self.looked
        if self.masks is not None:
            if frame not in self.masks.paths:
                raise FrameRejected(f"no mask of this frame in {self.masks.folder}")
            looked = replace(looked, mask=self.masks.mask(frame, color.shape[:2]))
        if depth is None:
            trace, found = trace_image(
                color, self.camera, position, self.length, self.recording.gravity, looked
            )
        elif not depth.any():
            raise FrameRejected("the depth image is empty")
        else:
            trace, found = trace_rgbd(
                color, depth, self.camera, position, self.length, self.radius, looked
            )
            check_spread(self.recording.path, frame, trace.points, self.length)
        if found.several:
            self.several.add(frame)
        return trace, found

    @property
    def measures_depth(self) -> bool:
        """Return whether the points are measured in space, not projected there from pictures
        alone."""
        rgbd = self.recording.manifest.rgbd
        return self.recording.source.table != "rgbd" or bool(rgbd and rgbd.depth)

    def learn_looks(self) -> None:
        """Learn how the rope looks from a few frames, so that others are quicker and alike.

        Nothing is learned where there are no pictures, few of them, very large ones, or a person
        has said where the rope is.
        """
        frames = self.recording.frames
        given = self.masks is not None or self.looked.color is not None
        if self.recording.source.table != "rgbd" or given or len(frames) <= LEARN_FROM:
            return
        found = []
        for frame in np.array(frames)[np.linspace(0, len(frames) - 1, LEARN_FROM).astype(int)]:
            sight = self.recording.source.sight(int(frame))
            assert sight.color is not None
            assert self.camera is not None
            if max(sight.color.shape) > LARGE_PICTURE:
                return
            try:
                position, _ = self.ends(int(frame))
                _, seen = self.trace_picture(int(frame), sight.color, sight.depth, position)
            except FrameRejected:
                continue
            known = np.isfinite(position).all(axis=1)
            tips = np.where(known[:, None], self.camera.project(np.nan_to_num(position)), np.nan)
            found.append(Picture(sight.color, sight.depth, tips, seen))
        self.looked = replace(self.looked, looks=best_looks(found))

    def view(self, points: np.ndarray) -> Camera:
        """Return the recording's camera, or a virtual one that sees points (N, 3)."""
        return self.camera or virtual_camera(points, self.recording.gravity, self._viewpoint())

    def _viewpoint(self) -> np.ndarray | None:
        clouds = self.recording.manifest.clouds
        return np.array(clouds.viewpoint) if clouds and clouds.viewpoint else None

    def _grips(self) -> Grips | None:
        """Return where the rope is held; None where there is no rope beyond. Raises BadInput."""
        recording, table = self.recording, self.recording.manifest.ends
        if table is None or table.arc_length is None or self.length is None:
            return None
        grips = Grips(*table.arc_length, self.length)
        if not grips.part_way.any():
            return None
        kinds = np.array([end.kind for end in recording.ends or ()])
        for end in np.flatnonzero(grips.part_way & (kinds != "clamped")):
            raise BadInput(
                f"{recording.path}: there is rope beyond end {end}, so the rope's direction there "
                "must be known: give a tangent, a quaternion or two held markers"
            )
        if recording.source.table != "markers" and not (~grips.part_way & (kinds != "free")).any():
            raise BadInput(
                f"{recording.path}: both grips have rope beyond them, and no points tell which "
                "end is end 0; hold an end, or use markers"
            )
        return grips

    def _camera(self) -> Camera | None:
        rgbd = self.recording.manifest.rgbd
        if rgbd is None:
            return None
        k = rgbd.intrinsics
        return Camera(k.width, k.height, k.fx, k.fy, k.cx, k.cy, np.array(rgbd.camera_pose))

    def _all_ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (F, 2, 3) [m] and orientations (F, 2, 4) in all frames; NaN where
        unknown."""
        count = len(self.recording.frames)
        ends, clamps = np.full((count, 2, 3), np.nan), np.full((count, 2, 4), np.nan)
        for t, frame in enumerate(self.recording.frames):
            for end, rows in enumerate(self.recording.ends or ()):
                if frame in rows.position and not self._held_jumps(end, frame):
                    ends[t, end] = rows.position[frame]
                    clamps[t, end] = rows.orientation.get(frame, np.nan)
        return ends, clamps

    def _held_jumps(self, end: int, frame: int) -> bool:
        table = self.recording.manifest.ends
        held = table.markers[end] if table and table.markers else []
        return frame in self.jumped and bool(self.jumped[frame][held].any())

    def _prepare_markers(self) -> None:
        frames = self.recording.frames
        points = [self.recording.source.sight(frame) for frame in frames]
        positions = np.stack([sight.points for sight in points])  # type: ignore[arg-type]
        time = self.recording.times(frames)
        self.warnings += lost_frames(frames, positions, time)
        sizes = jumps(positions, time)
        masked = sizes > 0
        self.jumped = dict(zip(frames, masked, strict=True))
        self.warnings += checks.jumped(frames, sizes)
        positions[masked] = np.nan
        ends, _ = self._all_ends()
        ends = ends if self.grips is None else self.grips.at_ends(ends)
        known = points[0].arc_length
        if known is not None:
            self.arc = known
            self.total = self.length or float(known[-1])
            if known[-1] > self.total * (1 + 1e-6):
                raise BadInput(
                    f"{self.recording.path}: arc_length reaches {known[-1]:g} m beyond the rope's "
                    f"length {self.total:g} m"
                )
            self._measure_noise(positions)
            assert self.noise is not None
            self.warnings += checks.long_chords(frames, positions, known, self.noise)
            return
        try:
            self.arc, self.total = marker_arc(positions, ends, self.length)
        except FrameRejected as reason:
            raise BadInput(f"{self.recording.path}: [markers]: {reason}")
        self._measure_noise(positions)
        self.warnings += checks.cut_corners(positions, ends, self.length)

    def _measure_noise(self, positions: np.ndarray) -> None:
        given = self.recording.manifest.priors.marker_noise
        if given is not None:
            self.noise, self.noise_source = given, "[priors] marker_noise"
            return
        time = self.recording.times(self.recording.frames)
        self.noise, self.noise_source, self.noise_known = marker_noise(positions, time, self.arc)


def tangents(orientation: np.ndarray) -> np.ndarray:
    """Return (..., 3) third directors of quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(orientation, -1, 0)
    return np.stack(
        [2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z], axis=-1
    )
