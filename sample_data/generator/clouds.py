"""One-sided point clouds, as a depth camera sees the rope."""

from pathlib import Path

import numpy as np
import open3d as o3d
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from generator.recording import Truth
from generator.rope import Array
from generator.scene import Camera, Scene, looking_at, tube

VIEWPOINT = np.array([0.10, -1.35, 0.50])  # m
TARGET = np.array([-0.05, 0.0, 0.42])  # m
WIDTH, HEIGHT, FOCAL = 640, 480, 610.0  # pixels
AXIAL_NOISE = 0.001  # m, sd at REFERENCE_DEPTH, grows with depth squared
REFERENCE_DEPTH = 1.35  # m
LATERAL_NOISE = 0.0003  # m, sd
OUTLIERS = 0.01  # share of points
OUTLIER_DISTANCE = 0.03  # m, sd per axis
GRIPPER = (0.04, 0.07)  # m, rope hidden beside end 0
GAP = (0.03, 0.05)  # m, rope hidden elsewhere in every third frame


def write_clouds(folder: Path, truth: Truth, rng: np.random.Generator) -> str:
    """Write ``clouds/*.ply`` and return the ``[clouds]`` table."""
    (folder / "clouds").mkdir()
    gaps = set(rng.permutation(len(truth.nodes))[: len(truth.nodes) // 3].tolist())
    for frame, nodes in enumerate(truth.nodes):
        points = _seen_points(nodes, truth, frame in gaps, rng)
        positions = o3d.core.Tensor(rng.permutation(points).astype(np.float32))
        path = folder / "clouds" / f"{frame:06d}.ply"
        o3d.t.io.write_point_cloud(str(path), o3d.t.geometry.PointCloud(positions))
    viewpoint = ", ".join(f"{value}" for value in VIEWPOINT)
    return f'[clouds]\npattern = "clouds/{{frame:06d}}.ply"\nviewpoint = [{viewpoint}]\n'


def _seen_points(nodes: Array, truth: Truth, gap: bool, rng: np.random.Generator) -> Array:
    """Noisy points (m, 3) [m] on the side of one rope that faces the camera."""
    camera = Camera(WIDTH, HEIGHT, FOCAL, looking_at(VIEWPOINT, TARGET))
    pixels = camera.pixels()
    # Without jitter a thin rope shows the rows and columns of the sensor.
    rays = camera.rays(pixels + rng.uniform(-0.5, 0.5, pixels.shape)).reshape(-1, 6)
    hits = Scene([tube(nodes, truth.arc_length, 0.5 * truth.rope.diameter)]).cast(rays)

    facing = -(hits.normals * rays[:, 3:]).sum(-1) / np.linalg.norm(rays[:, 3:], axis=1)
    # Light that strikes at a grazing angle seldom comes back.
    seen = (hits.mesh == 0) & (facing > 0.6 * rng.random(len(rays)))
    directions, depth = rays[seen, 3:], hits.depth[seen]
    points = VIEWPOINT + depth[:, None] * directions

    curve = CubicSpline(truth.arc_length, nodes)
    stations = np.linspace(0.0, truth.rope.length, 2001)
    arc_length = stations[cKDTree(curve(stations)).query(points)[1]]
    visible = arc_length > rng.uniform(*GRIPPER)
    if gap:
        start = rng.uniform(0.2, 0.8) * truth.rope.length
        visible &= (arc_length < start) | (arc_length > start + rng.uniform(*GAP))
    points, directions, depth = points[visible], directions[visible], depth[visible]

    along = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    lateral = LATERAL_NOISE * rng.standard_normal(points.shape)
    lateral -= (lateral * along).sum(-1, keepdims=True) * along
    axial = AXIAL_NOISE * (depth / REFERENCE_DEPTH) ** 2 * rng.standard_normal(len(points))
    points = points + lateral + axial[:, None] * along
    stray = rng.random(len(points)) < OUTLIERS
    points[stray] += OUTLIER_DISTANCE * rng.standard_normal((int(stray.sum()), 3))
    return points
