"""simulate: a synthetic recording of a nominal rope, with a chosen path of its ends, noise,
occlusion.

For trying out a set-up and for tests of the tool itself. The rope is ropefit's own model, so a fit
to such a recording says nothing about real ropes: proofs use recordings made by other simulators.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ropefit.errors import BadInput, NotConverged, StageFailed
from ropefit.inference.rope import Ends, bounds, build_rope, eta_names, initial
from ropefit.perception.trace import polyline_arc, resample
from ropefit.recordings.ends import quaternion_along
from ropefit.recordings.manifest import describe, read_toml
from ropefit.solvers.xpbd.reference import Settings
from ropefit.stages.stage import Progress

Point = tuple[float, float, float]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class RopeSpec(_Table):
    """length, diameter [m], mass [kg], particles."""

    length: float = Field(gt=0, le=100)
    diameter: float = Field(default=0.008, gt=0, le=1)
    mass: float | None = Field(default=None, gt=0)
    nodes: int = Field(default=20, ge=4, le=400)


class EndSpec(_Table):
    """Waypoints [m] that an end passes, evenly in time; tangents (not normalised) clamp it."""

    path: list[Point] = Field(min_length=1)
    tangents: list[Point] | None = None


class MotionSpec(_Table):
    """frames at `interval` [s]; an end that is left out is free."""

    frames: int = Field(ge=1, le=100_000)
    interval: float = Field(default=1.0, gt=0)
    end0: EndSpec | None = None
    end1: EndSpec | None = None

    @model_validator(mode="after")
    def _held(self) -> MotionSpec:
        if self.end0 is None and self.end1 is None:
            raise ValueError("give at least one of end0, end1: a rope with two free ends falls")
        return self


class ModelSpec(_Table):
    """The paper's model: solver, weights, steps x iterations."""

    solver: Literal["jacobi", "thomas"] = "thomas"
    eta: dict[str, float] = Field(default_factory=dict)
    steps: int = Field(default=50, ge=1, le=1000)
    iterations: int = Field(default=20, ge=1, le=100_000)
    dt: float = Field(default=0.1, gt=0)

    @model_validator(mode="after")
    def _known(self) -> ModelSpec:
        for name, value in self.eta.items():
            if name not in eta_names(False):
                raise ValueError(f"unknown weight {name}; one of {', '.join(eta_names(False))}")
            low, high = bounds(name)
            if not low <= value <= high:
                raise ValueError(f"{name} = {value:g} is outside {low:g}..{high:g}")
        return self


class SensorSpec(_Table):
    """clouds: `points` a frame on the tube's surface that faces `viewpoint`; markers: `points`
    evenly.

    noise, end_noise [m]; outliers: share of points; occluded: arc-length intervals [m] never seen.
    """

    kind: Literal["clouds", "markers"] = "clouds"
    points: int = Field(default=1000, ge=2, le=1_000_000)
    noise: float = Field(default=0.001, ge=0)
    end_noise: float = Field(default=0.0, ge=0)
    outliers: float = Field(default=0.0, ge=0, lt=0.5)
    occluded: list[tuple[float, float]] = Field(default_factory=list)
    viewpoint: Point | None = None
    seed: int = 0


class SimulationSpec(_Table):
    """The whole of SPEC.toml."""

    format: Literal["ropefit-simulation/1"]
    name: str = Field(min_length=1, max_length=200)
    gravity: Point = (0.0, 0.0, -9.81)
    rope: RopeSpec
    motion: MotionSpec
    model: ModelSpec = ModelSpec()
    sensor: SensorSpec = SensorSpec()


def simulate_recording(spec: Path, out: Path, progress: Progress, say: Any) -> dict[str, Any]:
    """Write the recording that SPEC.toml describes. Raises BadInput, NotConverged, StageFailed."""
    parsed = _read_spec(spec)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise StageFailed(f"{out}: exists already; give a new directory as --out")
    progress(0.1, "solving")
    x, ends = _states(parsed, spec)
    progress(0.8, "writing")
    temporary = None
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
        _write(parsed, x, ends, temporary)
        os.chmod(temporary, 0o755)
        os.replace(temporary, out)
    except OSError as error:
        raise StageFailed(f"cannot write {out}: {error.strerror}")
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
    say("made by ropefit's own model: good for trying a set-up, not as evidence for it")
    return {"stage": "simulate", "recording": str(out), "frames": len(x), "name": parsed.name}


def _read_spec(path: Path) -> SimulationSpec:
    try:
        return SimulationSpec.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(f"{path}: {describe(error)}")


def _states(spec: SimulationSpec, path: Path) -> tuple[np.ndarray, Ends]:
    """(F, K, 3) [m] centrelines and the exact end poses. `path` is named in failures."""
    frames = spec.motion.frames
    position = np.full((frames, 2, 3), np.nan)
    orientation = np.full((frames, 2, 4), np.nan)
    for number, end in enumerate((spec.motion.end0, spec.motion.end1)):
        if end is None:
            continue
        position[:, number] = _along(end.path, frames)
        if end.tangents:
            tangents = _along(end.tangents, frames)
            if (np.linalg.norm(tangents, axis=1) < 1e-9).any():
                raise BadInput(f"{path}: motion.end{number}.tangents: one vanishes on the way")
            orientation[:, number] = [quaternion_along(tangent) for tangent in tangents]
    apart = np.linalg.norm(position[:, 1] - position[:, 0], axis=1)
    if np.nanmax(np.append(apart, 0.0)) > spec.rope.length:
        worst = int(np.nanargmax(apart))
        raise BadInput(
            f"{path}: motion: in frame {worst} the ends are {apart[worst]:.4g} m apart, the rope "
            f"is {spec.rope.length:.4g} m long"
        )
    m = spec.model
    ends = Ends(position, orientation)
    rope = build_rope(
        length=spec.rope.length,
        nodes=spec.rope.nodes,
        gravity=np.array(spec.gravity),
        ends=ends,
        solver=m.solver,
        settings=Settings(m.steps, m.iterations, m.dt),
        control_node=0 if spec.motion.end0 else spec.rope.nodes - 1,
    )
    eta = torch.tensor([[m.eta.get(name, initial(name)) for name in rope.names]] * frames)
    with torch.no_grad():
        state = rope.settle(eta.to(torch.float64))
    if not torch.isfinite(state.x).all():
        raise NotConverged("the solver diverges with these weights; lower them or use more steps")
    return state.x.numpy(), ends


def _along(waypoints: list[Point], frames: int) -> np.ndarray:
    points = np.array(waypoints, dtype=float)
    at = np.linspace(0, len(points) - 1, frames)
    return resample(points, np.arange(len(points)), at)


def _write(spec: SimulationSpec, x: np.ndarray, ends: Ends, directory: Path) -> None:
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
    import json

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
