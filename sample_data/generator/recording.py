"""What the three recordings share: shapes, ends, truth, and how they are written."""

import csv
import shutil
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from generator.rope import GRAVITY, Array, EndPoses, Rope, SettledRope

FRAME_INTERVAL = 1.0  # s
END_NOISE = 0.00015  # m, sd per axis
TILT_NOISE = np.radians(0.2)  # rad, sd per axis of a clamp's measured orientation


@dataclass(frozen=True)
class Truth:
    """What the sensors will look at: centrelines (frames, n, 3) [m] at ``arc_length`` (n,) [m]."""

    rope: Rope
    poses: list[EndPoses]
    nodes: Array
    arc_length: Array

    @property
    def times(self) -> Array:
        """Time of every frame [s]."""
        return FRAME_INTERVAL * np.arange(len(self.poses))


def settle_all(rope: Rope, poses: list[EndPoses]) -> Truth:
    """The rope at rest in every pose, reached one from the other."""
    settled = SettledRope(rope, poses[0])
    nodes = np.stack([settled.settle(pose) for pose in poses])
    lengths = np.linalg.norm(np.diff(nodes, axis=1), axis=2).sum(axis=1)
    stretch = np.abs(lengths / rope.length - 1).max()
    if stretch > 0.003:
        raise RuntimeError(f"the simulated rope changed its length by {100 * stretch:.2f} %")
    print(f"  {len(poses)} frames at rest, length changed by at most {100 * stretch:.3f} %")
    return Truth(rope, poses, nodes, settled.arc_length)


def start_folder(folder: Path) -> None:
    """An empty ``folder``, so that no file of an earlier run stays behind."""
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)


def write_truth(folder: Path, truth: Truth) -> None:
    """``truth.npz``: for tests only, ropefit never reads it."""
    np.savez_compressed(
        folder / "truth.npz",
        nodes=truth.nodes,
        arc_length=truth.arc_length,
        EI=truth.rope.bending_rigidity,
        mass_per_length=truth.rope.mass_per_length,
    )


def write_ends(folder: Path, truth: Truth, rng: np.random.Generator) -> None:
    """``ends.csv``: measured end positions [m] and, for clamped ends, orientations."""
    columns = ["frame", "time", "end", "x", "y", "z"]
    clamped = truth.poses[0].tangents is not None
    if clamped:
        columns += ["qw", "qx", "qy", "qz"]
    with (folder / "ends.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for frame, pose in enumerate(truth.poses):
            positions = pose.positions + END_NOISE * rng.standard_normal((2, 3))
            cells = [[f"{value:.6f}" for value in position] for position in positions]
            if clamped:
                for cell, rotation in zip(cells, _end_rotations(pose, truth, frame), strict=True):
                    tilt = Rotation.from_rotvec(TILT_NOISE * rng.standard_normal(3))
                    x, y, z, w = (tilt * rotation).as_quat(canonical=True)
                    cell += [f"{value:.7f}" for value in (w, x, y, z)]
            for end, cell in enumerate(cells):
                writer.writerow([frame, f"{truth.times[frame]:.3f}", end, *cell])


def write_toml(folder: Path, rope: Rope, name: str, sensor_table: str) -> None:
    """``recording.toml``; ``sensor_table`` is the table of the recording's sensor."""
    gravity = ", ".join(f"{value}" for value in GRAVITY)
    (folder / "recording.toml").write_text(
        f"""format = "ropefit-recording/1"
name = "{name}"
gravity = [{gravity}]

[rope]
length = {rope.length}
diameter = {rope.diameter}
mass = {rope.mass}

[ends]
file = "ends.csv"

{sensor_table.strip()}
"""
    )


def _end_rotations(pose: EndPoses, truth: Truth, frame: int) -> tuple[Rotation, Rotation]:
    """Material frames at both ends, e3 along the tangent.

    End 0's is end 1's carried along the rope without twist, because the true rope has none.
    """
    assert pose.tangents is not None
    tangent = pose.tangents[1]
    side = np.array([0.0, 1.0, 0.0])
    side -= (side @ tangent) * tangent
    side /= np.linalg.norm(side)
    at_end_1 = Rotation.from_matrix(np.stack([np.cross(side, tangent), side, tangent], axis=1))

    edges = np.diff(truth.nodes[frame], axis=0)
    tangents = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    tangents = np.vstack([pose.tangents[:1], tangents, pose.tangents[1:]])[::-1]
    rotation = at_end_1
    for before, after in pairwise(tangents):
        rotation = _shortest_rotation(before, after) * rotation
    return rotation, at_end_1


def _shortest_rotation(before: Array, after: Array) -> Rotation:
    """The rotation without spin that takes one unit vector to another."""
    quaternion = np.append(np.cross(before, after), 1 + before @ after)
    return Rotation.from_quat(quaternion)
