"""A synthetic rope as a sensor would record it: noise, occlusion, outliers, and the files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from ropefit.adapters.synthetic_spec import SimulationSpec
from ropefit.models.xpbd import Ends
from ropefit.perception.trace import polyline_arc, resample


def write_recording(spec: SimulationSpec, x: np.ndarray, ends: Ends, directory: Path) -> None:
    rng = np.random.default_rng(spec.sensor.seed)
    s = spec.sensor
    viewpoint = np.array(s.viewpoint) if s.viewpoint else _viewpoint(spec, x)
    lines = [
        'format = "ropefit-recording/1"',
        f"name = {_quoted(spec.name)}",
        f"gravity = {list(spec.gravity)}",
        "",
        "[rope]",
        f"length = {spec.rope.length}",
        f"diameter = {spec.rope.diameter}",
        *([f"mass = {spec.rope.mass}"] if spec.rope.mass else []),
        "",
        "[ends]",
        'file = "ends.csv"',
        "",
        f"[{s.kind}]",
    ]
    _write_ends(spec, ends, rng, directory / "ends.csv")
    if s.kind == "clouds":
        lines += ['pattern = "clouds/{frame:06d}.ply"', f"viewpoint = {viewpoint.tolist()}"]
        (directory / "clouds").mkdir()
        for frame, line in enumerate(x):
            points = _surface(spec, line, viewpoint, rng)
            _write_ply(directory / "clouds" / f"{frame:06d}.ply", points)
    else:
        arc = np.linspace(0, spec.rope.length, s.points)
        lines += ['file = "markers.csv"', f"arc_length = {arc.round(9).tolist()}"]
        _write_markers(spec, x, arc, rng, directory / "markers.csv")
    (directory / "recording.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _quoted(text: str) -> str:
    """A TOML string; JSON's escapes are TOML's but for pairs of surrogates and DEL."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _viewpoint(spec: SimulationSpec, x: np.ndarray) -> np.ndarray:
    """A camera 1.5 rope lengths away from the middle, level, across the rope's widest spread."""
    flat = x.reshape(-1, 3)
    centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
    across = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][-1]
    return centre - 1.5 * spec.rope.length * across


def _write_ends(spec: SimulationSpec, ends: Ends, rng: np.random.Generator, path: Path) -> None:
    clamped = np.isfinite(ends.orientation).any()
    rows = ["frame,time,end,x,y,z" + (",qw,qx,qy,qz" if clamped else "")]
    for frame in range(spec.motion.frames):
        for end in (0, 1):
            if not np.isfinite(ends.position[frame, end, 0]):
                continue
            point = ends.position[frame, end] + rng.normal(0, spec.sensor.end_noise, 3)
            cells = [frame, frame * spec.motion.interval, end, *point.tolist()]
            quaternion = ends.orientation[frame, end]
            if np.isfinite(quaternion[0]):
                cells += quaternion.tolist()
            elif clamped:
                cells += [""] * 4
            rows.append(",".join(f"{c:.9g}" if isinstance(c, float) else str(c) for c in cells))
    path.write_text("\n".join(rows) + "\n")


def _hidden(spec: SimulationSpec, arc: np.ndarray) -> np.ndarray:
    return np.any([(arc >= a) & (arc <= b) for a, b in spec.sensor.occluded], axis=0)


def _surface(
    spec: SimulationSpec, line: np.ndarray, viewpoint: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(N, 3) [m] noisy points on the half of the tube that faces the viewpoint."""
    s = spec.sensor
    own = polyline_arc(line)
    arc = rng.uniform(0, own[-1], s.points)
    arc = arc[~_hidden(spec, arc)] if s.occluded else arc
    centre = resample(line, own, arc)
    ahead = resample(line, own, arc + 1e-4) - resample(line, own, arc - 1e-4)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    eye = viewpoint - centre
    eye -= (eye * ahead).sum(axis=1, keepdims=True) * ahead
    eye /= np.linalg.norm(eye, axis=1, keepdims=True)
    side = rng.uniform(-1, 1, (len(arc), 1))
    radius = spec.rope.diameter / 2
    tube = radius * (side * np.cross(ahead, eye) + np.sqrt(1 - side**2) * eye)
    points = centre + tube + rng.normal(0, s.noise, tube.shape)
    stray = rng.random(len(points)) < s.outliers
    points[stray] += rng.normal(0, 0.03 * spec.rope.length, (int(stray.sum()), 3))
    return points


def _write_ply(path: Path, points: np.ndarray) -> None:
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


def _write_markers(
    spec: SimulationSpec, x: np.ndarray, arc: np.ndarray, rng: np.random.Generator, path: Path
) -> None:
    rows = ["frame,time,marker,x,y,z"]
    hidden = _hidden(spec, arc) if spec.sensor.occluded else np.zeros(len(arc), dtype=bool)
    for frame, line in enumerate(x):
        own = polyline_arc(line)
        points = resample(line, own, arc * own[-1] / spec.rope.length)
        points = points + rng.normal(0, spec.sensor.noise, points.shape)
        points[hidden] = np.nan
        for marker, point in enumerate(points):
            cells = ",".join(f"{value:.9g}" for value in point)
            rows.append(f"{frame},{frame * spec.motion.interval:.9g},{marker},{cells}")
    path.write_text("\n".join(rows) + "\n")
