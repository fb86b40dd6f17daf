"""observations.h5: what preprocess makes of a recording, frame by frame, ready for any loss."""

from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ropefit.artifacts.base import ArraySpec, Artifact, Part, quantity

EndKind = Literal["free", "pinned", "clamped"]


class View(Part):
    """A pinhole camera: pixel = (fx X/Z + cx, fy Y/Z + cy) in OpenCV axes."""

    width: int = Field(gt=0)
    height: int = Field(gt=0)
    fx: float = quantity("px", gt=0)
    fy: float = quantity("px", gt=0)
    cx: float = quantity("px")
    cy: float = quantity("px")
    pose: Annotated[np.ndarray, ArraySpec(("row", "column"))]  # recording <- camera
    virtual: bool = Field(description="true when the recording has no camera and one was assumed")


class SetupPriors(Part):
    """One-sigma uncertainty of the set-up as the recording gives it; null: the default."""

    camera_rotation: float | None = quantity("deg", default=None)
    camera_translation: float | None = quantity("m", default=None)
    scale: float | None = None
    depth_gain: float | None = None
    gravity: float | None = quantity("deg", default=None)
    end_position: float | None = quantity("m", default=None)
    end_orientation: float | None = quantity("deg", default=None)
    time_lag: float | None = quantity("s", default=None)
    length: float | None = quantity("m", default=None)
    mass: float | None = quantity("kg", default=None)


class Fitting(Part):
    """A rigid piece on the rope; of no length: a point."""

    arc_length: float = quantity("m", "of its middle")
    length: float = quantity("m", default=0.0)
    mass: float = quantity("kg", "besides the rope's", default=0.0)


class DroppedFrame(Part):
    """A frame of the recording that is not used, and why."""

    frame: int
    reason: str


class Observations(Artifact):
    """Ordered points, segments, plane, ends and noise of every usable frame."""

    schema_name: ClassVar[str] = "ropefit-observations"
    schema_version: ClassVar[int] = 5
    file_name: ClassVar[str] = "observations.h5"

    recording: str
    recording_path: str
    source: Literal["clouds", "rgbd", "markers"]
    gravity: Annotated[np.ndarray, ArraySpec(("xyz",), "m/s^2")]
    length: float = quantity("m", "rest length of the rope", gt=0)
    length_source: Literal["recording", "estimated", "assumed"]
    diameter: float | None = quantity("m", default=None)
    mass: float | None = quantity("kg", "whole rope", default=None)
    priors: SetupPriors = Field(default_factory=SetupPriors)
    marker_offset: float = quantity(
        "m", "one sigma of how far markers lie off the axis, the same in all frames", default=0.0
    )
    fittings: dict[str, Fitting] = Field(default_factory=dict)

    frames: Annotated[np.ndarray, ArraySpec(("frame",), dtype="int64")]
    # None: the recording has no times, as single poses at rest have none.
    time: Annotated[np.ndarray, ArraySpec(("frame",), "s")] | None = None
    dropped: list[DroppedFrame] = Field(default_factory=list)

    end_kind: tuple[EndKind, EndKind]
    ends_assumed: bool = Field(
        description="no [ends] in the recording: the visible ends are taken as pinned"
    )
    end_twist_known: bool = Field(
        default=True,
        description="false: clamps are tangents or pairs of markers, which show no twist",
    )
    end_position: Annotated[np.ndarray, ArraySpec(("frame", "end", "xyz"), "m", nan=True)]
    end_orientation: Annotated[np.ndarray, ArraySpec(("frame", "end", "wxyz"), nan=True)]

    # Points in order of arc length; frame t owns rows point_start[t]:point_start[t + 1].
    points: Annotated[np.ndarray, ArraySpec(("point", "xyz"), "m")]
    point_arc: Annotated[np.ndarray, ArraySpec(("point",), "m")]
    point_offset: Annotated[np.ndarray, ArraySpec(("point",), "m")]  # signed, out of the plane
    # How far the visible surface of a round rope was before its axis, where the point now lies.
    point_before: Annotated[np.ndarray, ArraySpec(("point",), "m")] | None = None
    point_start: Annotated[np.ndarray, ArraySpec(("boundary",), dtype="int64")]
    projected: bool = Field(description="points lie in the plane of gravity and the two ends")
    projection_reason: str
    plane_origin: Annotated[np.ndarray, ArraySpec(("frame", "xyz"), "m")]
    plane_normal: Annotated[np.ndarray, ArraySpec(("frame", "xyz"))]

    # The same in the image; seen by `view`.
    view: View
    pixels: Annotated[np.ndarray, ArraySpec(("pixel", "uv"), "px")]
    pixel_arc: Annotated[np.ndarray, ArraySpec(("pixel",), "m")]
    pixel_start: Annotated[np.ndarray, ArraySpec(("boundary",), dtype="int64")]

    # K segment boundaries c_i and whether the K - 1 segments between them are seen.
    node_arc: Annotated[np.ndarray, ArraySpec(("node",), "m")]
    centreline: Annotated[np.ndarray, ArraySpec(("frame", "node", "xyz"), "m", nan=True)]
    centreline_px: Annotated[np.ndarray, ArraySpec(("frame", "node", "uv"), "px", nan=True)]
    seen: Annotated[np.ndarray, ArraySpec(("frame", "segment"), dtype="bool")]
    lowest: Annotated[np.ndarray, ArraySpec(("frame", "xyz"), "m")]
    noise: Annotated[np.ndarray, ArraySpec(("frame",), "m")]  # sd of a point, per coordinate
    noise_source: str
    # The part of the noise that neighbouring points share, from what is left after a curve that
    # bends as much as a rope credibly may. None where it cannot be measured.
    noise_white: Annotated[np.ndarray, ArraySpec(("frame",), "m", nan=True)] | None = None
    noise_correlated: float | None = quantity(
        "m", "sd of the part that is correlated along the rope", default=None
    )
    noise_length: float | None = quantity(
        "m", "distance along the rope over which that part falls to 1/e", default=None
    )
    traced_length: Annotated[np.ndarray, ArraySpec(("frame",), "m")] | None = None
    length_sd: float | None = quantity(
        "m", "spread of traced_length over frames: of the arc-length estimate", default=None
    )
    quality: Annotated[np.ndarray, ArraySpec(("frame",))] | None = None
    depth_measured: bool = Field(
        default=True,
        description="false: points are pixels projected onto an assumed plane, not measured",
    )

    # A few pictures with what was seen in them: JPEG files one after the other.
    pictures: Annotated[np.ndarray, ArraySpec(("byte",), dtype="uint8")] | None = None
    picture_start: Annotated[np.ndarray, ArraySpec(("picture_boundary",), dtype="int64")] | None = (
        None
    )
    picture_frame: Annotated[np.ndarray, ArraySpec(("picture",), dtype="int64")] | None = None
    picture_text: list[str] = Field(default_factory=list)

    @property
    def visibility(self) -> np.ndarray:
        """Return (frame,) fraction of the rope's segments that are seen."""
        return self.seen.mean(axis=1)

    @property
    def noise_bounded(self) -> bool:
        """Return whether the noise is an upper bound, or assumed: neither told nor measured."""
        return self.noise_source.startswith("assumed") or "upper bound" in self.noise_source

    @property
    def noise_distance(self) -> float:
        """Return the rms distance [m] from the rope at which noise alone leaves a point.

        That of a typical frame. Across a rope are two coordinates, in a picture one.
        """
        across = 2 if self.depth_measured else 1
        return float(np.sqrt(across) * np.median(self.noise))
