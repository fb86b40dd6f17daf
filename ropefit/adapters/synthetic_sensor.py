"""A synthetic rope as a sensor would record it: noise, occlusion, outliers, and the files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.adapters.synthetic_spec import SimulationSpec
from ropefit.perception.trace import polyline_arc, resample
from ropefit.recordings.writer import About, RecordingWriter
from ropefit.rod.setup import Setup


def write_recording(spec: SimulationSpec, x: np.ndarray, setup: Setup, directory: Path) -> None:
    """Write centrelines x (F, K, 3) [m] and a setup's ends as the recording that a sensor would
    give."""
    rng = np.random.default_rng(spec.sensor.seed)
    s, rope = spec.sensor, spec.matter
    viewpoint = np.array(s.viewpoint) if s.viewpoint else _viewpoint(spec, x)
    about = About(spec.name, spec.gravity, rope.length, rope.diameter, rope.mass)
    writer = RecordingWriter(directory, about)
    time = np.array([float(f"{spec.motion.interval * frame:.9g}") for frame in range(len(x))])
    _write_ends(spec, setup, time, rng, writer)
    if s.kind == "clouds":
        for frame, line in enumerate(x):
            writer.write_cloud(frame, _surface(spec, line, viewpoint, rng))
        writer.clouds_table(viewpoint)
    else:
        arc = np.linspace(0, rope.length, s.points)
        writer.write_markers_text(_markers(spec, x, arc, rng), time, arc.round(9))
    writer.finish()


def _viewpoint(spec: SimulationSpec, x: np.ndarray) -> np.ndarray:
    """Return a camera 1.5 rope lengths away from the middle, level, across the rope's widest
    spread."""
    flat = x.reshape(-1, 3)
    centre = (flat.min(axis=0) + flat.max(axis=0)) / 2
    across = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][-1]
    return centre - 1.5 * spec.matter.length * across


def _write_ends(
    spec: SimulationSpec,
    setup: Setup,
    time: np.ndarray,
    rng: np.random.Generator,
    writer: RecordingWriter,
) -> None:
    position, orientation = setup.ends, setup.clamp
    for frame in range(spec.motion.frames):
        for end in (0, 1):
            if not np.isfinite(position[frame, end, 0]):
                continue
            point = position[frame, end] + rng.normal(0, spec.sensor.end_noise, 3)
            turn = orientation[frame, end]
            known = turn if np.isfinite(turn[0]) else None
            writer.end(frame, float(time[frame]), end, point, known)


def _hidden(spec: SimulationSpec, arc: np.ndarray) -> np.ndarray:
    return np.any([(arc >= a) & (arc <= b) for a, b in spec.sensor.occluded], axis=0)


def _surface(
    spec: SimulationSpec, line: np.ndarray, viewpoint: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return (N, 3) [m] noisy points on the half of the tube that faces the viewpoint."""
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
    radius = spec.matter.diameter / 2
    tube = radius * (side * np.cross(ahead, eye) + np.sqrt(1 - side**2) * eye)
    points = centre + tube + rng.normal(0, s.noise, tube.shape)
    stray = rng.random(len(points)) < s.outliers
    points[stray] += rng.normal(0, 0.03 * spec.matter.length, (int(stray.sum()), 3))
    return points


def _markers(
    spec: SimulationSpec, x: np.ndarray, arc: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, M, 3) [m] noisy markers at arc lengths (M,) [m], NaN where hidden."""
    hidden = _hidden(spec, arc) if spec.sensor.occluded else np.zeros(len(arc), dtype=bool)
    found = []
    for line in x:
        own = polyline_arc(line)
        points = resample(line, own, arc * own[-1] / spec.matter.length)
        points = points + rng.normal(0, spec.sensor.noise, points.shape)
        points[hidden] = np.nan
        found.append(points)
    return np.array(found)
