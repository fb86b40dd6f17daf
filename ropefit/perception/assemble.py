"""All frames together: lengths agreed, ends filled in, plane, segments, visibility, noise,
image."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ropefit.errors import BadInput
from ropefit.perception.camera import Camera, downwards
from ropefit.perception.cloud import scatter
from ropefit.perception.noise import measure
from ropefit.perception.plane import hanging_plane
from ropefit.perception.trace import Trace, resample
from ropefit.perception.tracing import Tracer

# A rope that leaves the plane by more than this share of its length and this many times the noise
# is not flattened: there the projection would hide shape, not noise.
KEEP_3D = 0.003
KEEP_3D_NOISE = 5.0
ALL_SEEN = 0.99  # of the length: more is measurement, less is occlusion
FLOOR = 1e-6  # m: no sensor is better


def assemble(
    tracer: Tracer, traces: list[Trace], frames: np.ndarray, nodes: int, project: str
) -> dict[str, Any]:
    """Return everything of observations.h5 that is computed from the traces of the usable
    frames."""
    position, orientation = (
        np.stack(part) for part in zip(*(tracer.ends(frame) for frame in frames), strict=True)
    )
    if tracer.recording.ends is None:
        position = _ends_seen(traces, tracer)
    length, source = _length(tracer, traces, position)
    if not 0 < length < 100:
        raise BadInput(
            f"{tracer.recording.path}: the rope comes out {length:.4g} m long; data are in metres"
        )
    noise = np.array([_noise(tracer, trace) for trace in traces])
    typical = float(np.median(noise)) if tracer.noise_known else None
    gravity = tracer.recording.gravity
    flat = _flattened(traces, position, gravity, project, length, typical)
    points, lines = flat.points, flat.lines
    node_arc = np.linspace(0.0, length, nodes)
    arcs = [_rescale(trace, length) for trace in traces]
    camera = tracer.view(np.concatenate(lines))
    seen = np.stack([_seen(a, t.reach, node_arc) for t, (a, _) in zip(traces, arcs, strict=True)])
    known = np.stack(
        [_covered(a, t.reach, node_arc) for t, (a, _) in zip(traces, arcs, strict=True)]
    )
    centreline = np.stack(
        [resample(line, arc, node_arc) for line, (_, arc) in zip(lines, arcs, strict=True)]
    )
    centreline[~known] = np.nan

    pixels, pixel_arcs = _pixels(traces, lines, points, arcs, camera, length)
    boundaries = [
        resample(pixel, np.maximum.accumulate(arc), node_arc)
        for pixel, arc in zip(pixels, pixel_arcs, strict=True)
    ]
    centreline_px = np.stack(boundaries)
    centreline_px[~known] = np.nan

    down = downwards(gravity)
    lowest = np.stack(
        [_lowest(line, arc, a, down) for line, (a, arc) in zip(lines, arcs, strict=True)]
    )
    return {
        "length": length,
        "length_source": source,
        "end_position": position,
        "end_orientation": orientation,
        "points": np.concatenate(points),
        "point_arc": np.concatenate([a for a, _ in arcs]),
        "point_offset": np.concatenate(flat.offsets),
        "point_start": _starts(points),
        "projected": flat.projected,
        "projection_reason": flat.reason,
        "plane_origin": np.stack([origin for origin, _ in flat.planes]),
        "plane_normal": np.stack([normal for _, normal in flat.planes]),
        "camera": camera,
        "pixels": np.concatenate(pixels),
        "pixel_arc": np.concatenate(pixel_arcs),
        "pixel_start": _starts(pixels),
        "node_arc": node_arc,
        "centreline": centreline,
        "centreline_px": centreline_px,
        "seen": seen,
        "lowest": lowest,
        "noise": np.maximum(noise, FLOOR),
        "noise_source": tracer.noise_source,
        "quality": np.array([trace.quality for trace in traces]),
        "depth_measured": tracer.measures_depth,
        "point_before": _before(traces),
        **_spread(traces),
    }


class _Flattened(NamedTuple):
    """Of each frame: points (P, 3) and line (K, 3) [m], in the plane (origin, normal) of gravity
    and the ends if projected; the points' offsets (P,) [m] from it. reason: of that choice."""

    points: list[np.ndarray]
    lines: list[np.ndarray]
    offsets: list[np.ndarray]
    planes: list[tuple[np.ndarray, np.ndarray]]
    projected: bool
    reason: str


def _flattened(
    traces: list[Trace], position: np.ndarray, gravity: np.ndarray, project: str, length: float,
    noise: float | None,
) -> _Flattened:  # fmt: skip
    """Project every frame onto the plane of gravity and its ends, unless that would hide shape."""
    planes = [
        hanging_plane(ends, gravity, trace.centreline)
        for ends, trace in zip(position, traces, strict=True)
    ]
    offsets = [
        ((trace.points - origin) @ normal, (trace.centreline - origin) @ normal)
        for trace, (origin, normal) in zip(traces, planes, strict=True)
    ]
    out_of_plane = float(np.sqrt(np.mean(np.concatenate([line**2 for _, line in offsets]))))
    projected, reason = _whether_to_project(project, out_of_plane, length, noise)
    factor = 1.0 if projected else 0.0
    points, lines = [], []
    for trace, (_, normal), (off, off_line) in zip(traces, planes, offsets, strict=True):
        points.append(trace.points - factor * off[:, None] * normal)
        lines.append(trace.centreline - factor * off_line[:, None] * normal)
    return _Flattened(points, lines, [off for off, _ in offsets], planes, projected, reason)


def _pixels(
    traces: list[Trace],
    lines: list[np.ndarray],
    points: list[np.ndarray],
    arcs: list[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    length: float,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return of each frame the rope's pixels (P, 2) and their arc lengths (P,) [m]."""
    pixels, pixel_arcs = [], []
    for trace, line, point, (arc, line_arc) in zip(traces, lines, points, arcs, strict=True):
        if trace.pixels is not None and trace.pixel_arc is not None:
            pixel, pixel_arc = trace.pixels, trace.pixel_arc * length / trace.length
        elif len(point) < 60:  # markers: the points themselves
            pixel, pixel_arc = camera.project(point), arc
        else:  # a cloud's denoised centreline stands in for the image's, where points were seen
            at = np.linspace(0, length, 200)
            at = at[_near(arc, at, length / 40)]
            pixel, pixel_arc = camera.project(resample(line, line_arc, at)), at
        pixels.append(pixel)
        pixel_arcs.append(pixel_arc)
    return pixels, pixel_arcs


def _before(traces: list[Trace]) -> np.ndarray | None:
    """Return (points,) [m] from the visible surface to the axis; None where no surface was seen."""
    moved = [trace.before for trace in traces if trace.before is not None]
    return np.concatenate(moved) if len(moved) == len(traces) else None


def _spread(traces: list[Trace]) -> dict[str, Any]:
    """Return the noise along the rope and the spread of the length as traced, where they can be
    had."""
    out: dict[str, Any] = {}
    found = measure(traces)
    if found is not None:
        out["noise_white"] = found.white
        out["noise_correlated"], out["noise_length"] = found.correlated, found.length
    traced = [trace.traced for trace in traces if trace.traced is not None]
    if len(traced) == len(traces):
        out["traced_length"] = np.array(traced)
        if len(traced) > 1:
            middle = float(np.median(traced))
            out["length_sd"] = float(1.4826 * np.median(np.abs(np.array(traced) - middle)))
    return out


def _length(tracer: Tracer, traces: list[Trace], position: np.ndarray) -> tuple[float, str]:
    """Return the rope's length [m] and where it is from: the recording, or estimated from what is
    seen.

    Where the ends are those seen and part of the rope is hidden, the rope between them is shorter
    than the recording says: what is seen counts.
    """
    visible = float(np.median([trace.length for trace in traces]))
    if not tracer.measures_depth and tracer.length is None and tracer.recording.ends is None:
        return visible, "assumed"
    hidden = tracer.recording.ends is None and visible < ALL_SEEN * (tracer.length or 0.0)
    if tracer.span and not hidden:
        return tracer.span, "recording"
    apart = np.linalg.norm(position[:, 1] - position[:, 0], axis=1)
    farthest = float(np.max(apart[np.isfinite(apart)], initial=0.0))
    return max(visible, farthest * 1.001), "estimated"


def _ends_seen(traces: list[Trace], tracer: Tracer) -> np.ndarray:
    """Return (F, 2, 3) ends as the data show them, end 0 staying the same one from frame to
    frame."""
    ends = np.stack([trace.centreline[[0, -1]] for trace in traces])
    if tracer.recording.source.table == "markers":
        return ends
    for t in range(1, len(ends)):
        straight = np.linalg.norm(ends[t] - ends[t - 1], axis=1).sum()
        crossed = np.linalg.norm(ends[t, ::-1] - ends[t - 1], axis=1).sum()
        if crossed < straight:
            ends[t] = ends[t, ::-1]
            traces[t] = _reversed(traces[t])
    return ends


def _reversed(trace: Trace) -> Trace:
    flip = slice(None, None, -1)
    return Trace(
        points=trace.points[flip],
        point_arc=trace.length - trace.point_arc[flip],
        centreline=trace.centreline[flip],
        arc=trace.length - trace.arc[flip],
        length=trace.length,
        reach=trace.reach,
        pixels=None if trace.pixels is None else trace.pixels[flip],
        pixel_arc=None if trace.pixel_arc is None else trace.length - trace.pixel_arc[flip],
        quality=trace.quality,
        traced=trace.traced,
    )


def _noise(tracer: Tracer, trace: Trace) -> float:
    if not tracer.measures_depth:
        # A path through a picture is smooth by construction and known to about half a pixel.
        step = np.linalg.norm(np.diff(trace.centreline, axis=0), axis=1)
        return 0.5 * float(np.median(step))
    return tracer.noise if tracer.noise is not None else scatter(trace.points, trace.centreline)


def _whether_to_project(
    project: str, out_of_plane: float, length: float, noise: float | None
) -> tuple[bool, str]:
    """Return whether to project, and why. noise [m]: None where it is assumed, or an upper bound;
    nothing is flattened on the strength of that."""
    noise_text = "noise is not measured" if noise is None else f"noise is {noise * 1e3:.2g} mm"
    share = (
        f"the rope leaves the plane of gravity and its ends by {out_of_plane * 1e3:.1f} mm rms "
        f"({noise_text})"
    )
    if project != "auto":
        return project == "yes", f"asked for; {share}"
    if out_of_plane > max(KEEP_3D * length, KEEP_3D_NOISE * (noise or 0.0)):
        return False, f"{share}: kept in 3D, a projection would hide shape"
    return True, f"{share}: projected"


def _rescale(trace: Trace, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (point arcs, centreline arcs) [m] on a rope of the agreed length."""
    factor = length / trace.length
    arc = np.maximum.accumulate(trace.arc * factor)
    return trace.point_arc * factor, arc


def _near(arc: np.ndarray, at: np.ndarray, reach: float) -> np.ndarray:
    """Return (M,) bool: places with a data point within `reach`."""
    ordered = np.sort(arc)
    right = np.clip(np.searchsorted(ordered, at), 0, len(ordered) - 1)
    left = np.maximum(right - 1, 0)
    return np.minimum(np.abs(ordered[right] - at), np.abs(ordered[left] - at)) <= reach


def _seen(arc: np.ndarray, reach: float, node_arc: np.ndarray) -> np.ndarray:
    """Return (K-1,) bool: segments that hold a data point or have one within `reach` of their
    middle."""
    middle = (node_arc[1:] + node_arc[:-1]) / 2
    half = (node_arc[1] - node_arc[0]) / 2
    return _near(arc, middle, max(reach, half))


def _covered(arc: np.ndarray, reach: float, node_arc: np.ndarray) -> np.ndarray:
    """Return (K,) bool: boundaries near enough to data to be compared with a particle."""
    half = (node_arc[1] - node_arc[0]) / 2
    return _near(arc, node_arc, max(reach, half))


def _lowest(
    line: np.ndarray, line_arc: np.ndarray, arc: np.ndarray, down: np.ndarray
) -> np.ndarray:
    """Return (3,) lowest point of the denoised centreline where there are data."""
    inside = (line_arc >= arc.min()) & (line_arc <= arc.max())
    candidates = line[inside] if inside.any() else line
    return candidates[np.argmax(candidates @ down)]


def _starts(parts: list[np.ndarray]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
