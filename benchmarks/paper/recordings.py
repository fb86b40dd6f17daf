"""The experiments' recordings as folders: rendered ones, and those made of what a run holds."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.paper.pipeline import Derived, MiddleTable, Rendered
from benchmarks.paper.rendering import baxter_gripper, frame, looking, needle_driver, post, wall
from benchmarks.paper.worlds import Truth, shapes
from ropefit.artifacts import Model, Observations
from ropefit.perception.camera import Camera
from ropefit.runs.loading import load

Array = np.ndarray
END_NOISE = 0.0005  # m, sd per axis and frame of a measured end
TILT_NOISE = np.radians(0.2)  # rad, likewise of a clamp
WALL_BEHIND = 0.45  # m behind the rope
GRAVITY = (0.0, 0.0, -9.81)  # m/s²
SPEC = "made-from.json"


def make(folder: Path, recording: Rendered) -> None:
    """Render a recording, unless the folder holds the same already."""
    spec = recording.model_dump_json()
    if (folder / SPEC).exists() and (folder / SPEC).read_text() == spec:
        return
    truth = shapes(recording)
    _start(folder)
    rng = np.random.default_rng([20261121, recording.seed])
    if recording.camera is not None:
        _see(folder, recording, truth, looking(*vars(recording.camera).values()), rng)
    positions, turns = _measured(truth, rng)
    told = [clamped and recording.tell_clamps for clamped in truth.held]
    _write_ends(folder, positions, turns, told)
    np.savez_compressed(
        folder / "truth.npz",
        arc=truth.arc,
        nodes=truth.nodes,
        gripper=truth.gripper,
        held=truth.held,
        positions=truth.positions,
        orientations=truth.orientations,
        measured=turns,
    )
    (folder / SPEC).write_text(spec)


def _see(
    folder: Path, recording: Rendered, truth: Truth, eye: Camera, rng: np.random.Generator
) -> None:
    """Render all frames: write the pictures, return the manifest that goes with them."""
    (folder / "color").mkdir()
    (folder / "depth").mkdir()
    rope = recording.rope
    for t, nodes in enumerate(truth.nodes):
        local, tip = eye.local(nodes), eye.local(truth.gripper[t : t + 1])[0]
        if isinstance(recording.motion, MiddleTable):
            boxes = needle_driver(tip, rope.diameter / 2)
        else:
            boxes = [*baxter_gripper(tip), *post(eye.local(truth.positions[t, 1:])[0])]
        boxes += wall(float(local[:, 2].max()) + WALL_BEHIND)
        color, depth = frame(
            truth.arc, local, rope.diameter / 2, rope.color, recording.marks, boxes, rng
        )
        cv2.imwrite(str(folder / "color" / f"{t:06d}.png"), color[..., ::-1])
        millimetres = np.round(1000 * depth).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{t:06d}.png"), millimetres)
    rows = ", ".join("[" + ", ".join(f"{v:.9f}" for v in row) + "]" for row in eye.pose)
    sensor = (
        '[rgbd]\ncolor = "color/{frame:06d}.png"\ndepth = "depth/{frame:06d}.png"\n'
        f"depth_scale = 0.001\ncamera_pose = [{rows}]\nintrinsics = {{ width = {eye.width}, "
        f"height = {eye.height}, fx = {eye.fx}, fy = {eye.fy}, cx = {eye.cx}, cy = {eye.cy} }}\n"
    )
    about = {"length": rope.length, "diameter": rope.diameter, "mass": rope.mass}
    _write_manifest(folder, about, sensor)


def derive(folder: Path, recording: Derived, run: Path, source: Path | None) -> None:
    """Make a recording of a run's artifacts; `source` is the recording that the run is of."""
    o, _ = load(run, Observations)
    _start(folder)
    ends, told = o.end_position, [kind == "clamped" for kind in o.end_kind]
    turns = o.end_orientation
    about = {"length": o.length, "mass": o.mass}
    if recording.kind == "shapes":
        model = load(run, Model)[0].nominal
        with (folder / "markers.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["frame", "time", "marker", "x", "y", "z"])
            for t, x in zip(o.frames, model.x, strict=True):
                for k, place in enumerate(x):
                    writer.writerow([t, f"{t:.3f}", k, *(f"{v:.6f}" for v in place)])
        arc = ", ".join(f"{s:.6f}" for s in o.node_arc)
        sensor = f'[markers]\nfile = "markers.csv"\narc_length = [{arc}]\n'
        kept = np.arange(len(o.frames))
    else:
        (folder / "clouds").mkdir()
        if recording.tell_clamps:
            assert source is not None
            true = load_truth(source)
            told, turns = list(true["held"]), true["measured"][o.frames]
        clouds = [o.points[a:b] for a, b in zip(o.point_start[:-1], o.point_start[1:], strict=True)]
        if recording.kind != "points":
            assert source is not None
            clouds, ends, turns, about = _one_side(source, o, clouds, int(recording.kind[-1]))
            told = [side == 1 - int(recording.kind[-1]) for side in (0, 1)]
        apart = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / about["length"]
        kept = np.flatnonzero(apart <= (recording.where or np.inf))
        for t in kept:
            _write_cloud(folder / "clouds" / f"{o.frames[t]:06d}.ply", clouds[t])
        sensor = '[clouds]\npattern = "clouds/{frame:06d}.ply"\n'
    _write_ends(folder, ends[kept], turns[kept], told, o.frames[kept])
    _write_manifest(folder, about, sensor)


def _one_side(
    source: Path, o: Observations, clouds: list[Array], side: int
) -> tuple[list[Array], Array, Array, dict[str, Any]]:
    """Return clouds, ends (T, 2, 3), orientations (T, 2, 4), sizes of one side of the gripper."""
    spec = Rendered.model_validate_json((source / SPEC).read_text())
    assert isinstance(spec.motion, MiddleTable)
    rng = np.random.default_rng([20261121, spec.seed, 7])
    with np.load(source / "truth.npz") as truth:
        grip = truth["gripper"][o.frames]
    grip = grip + END_NOISE * rng.standard_normal(grip.shape)
    parts = []
    for points, place in zip(clouds, grip, strict=True):
        cut = int(np.argmin(np.linalg.norm(points - place, axis=1)))
        parts.append(points[:cut] if side == 0 else points[cut:])
    length = spec.motion.at if side == 0 else spec.rope.length - spec.motion.at
    ends = np.stack([o.end_position[:, 0], grip] if side == 0 else [grip, o.end_position[:, 1]], 1)
    turns = np.full((len(grip), 2, 4), np.nan)
    level = np.roll(Rotation.from_euler("y", 90, degrees=True).as_quat(), 1)  # tangent along x
    turns[:, 1 - side] = level
    about = {"length": length, "mass": spec.rope.mass * length / spec.rope.length}
    return parts, ends, turns, about


def _start(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)


def _measured(truth: Truth, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return ends (T, 2, 3) and orientations (T, 2, 4) as a robot would know them."""
    positions = truth.positions + END_NOISE * rng.standard_normal(truth.positions.shape)
    turns = truth.orientations.copy()
    for t, end in np.ndindex(turns.shape[:2]):
        tilt = Rotation.from_rotvec(TILT_NOISE * rng.standard_normal(3))
        turn = tilt * Rotation.from_quat(np.roll(turns[t, end], -1))
        turns[t, end] = np.roll(turn.as_quat(), 1)
    return positions, turns


def _write_ends(
    folder: Path, positions: Array, turns: Array, told: list[bool], frames: Array | None = None
) -> None:
    frames = np.arange(len(positions)) if frames is None else frames
    with (folder / "ends.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "time", "end", "x", "y", "z", "qw", "qx", "qy", "qz"])
        for t, frame_number in enumerate(frames):
            for end in (0, 1):
                turn = turns[t, end] if told[end] else np.full(4, np.nan)
                cells = [f"{v:.6f}" for v in positions[t, end]] + [
                    f"{v:.7f}" if np.isfinite(v) else "" for v in turn
                ]
                writer.writerow([frame_number, f"{frame_number:.3f}", end, *cells])


def _write_cloud(path: Path, points: Array) -> None:
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    path.write_bytes(head.encode() + points.astype("<f4").tobytes())


def _write_manifest(folder: Path, about: dict[str, Any], sensor: str) -> None:
    rope = "\n".join(f"{name} = {value}" for name, value in about.items() if value)
    gravity = ", ".join(f"{value}" for value in GRAVITY)
    (folder / "recording.toml").write_text(
        f'format = "ropefit-recording/1"\nname = "{folder.name}"\ngravity = [{gravity}]\n\n'
        f'[rope]\n{rope}\n\n[ends]\nfile = "ends.csv"\n\n{sensor}'
    )


def load_truth(folder: Path) -> dict[str, Array]:
    """Return what is true of a rendered recording."""
    with np.load(folder / "truth.npz") as data:
        return {name: data[name] for name in data.files}
