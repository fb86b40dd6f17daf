"""Meshes and a pinhole camera for ray casting (no window, no OpenGL)."""

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from scipy.interpolate import CubicSpline

from generator.rope import Array

RING_SIDES = 32
RINGS = 400


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in OpenCV axes (x right, y down, z forward); pixel centres are integers.

    ``focal`` and the image size are in pixels; ``pose`` (4, 4) is recording ← camera [m].
    """

    width: int
    height: int
    focal: float
    pose: Array

    @property
    def center(self) -> tuple[float, float]:
        """Principal point [pixels]: the middle of the image."""
        return 0.5 * (self.width - 1), 0.5 * (self.height - 1)

    def pixels(self, supersample: int = 1) -> Array:
        """Pixel coordinates (height·s, width·s, 2) of a grid ``supersample`` times as fine."""
        u = (np.arange(self.width * supersample) + 0.5) / supersample - 0.5
        v = (np.arange(self.height * supersample) + 0.5) / supersample - 0.5
        return np.stack(np.meshgrid(u, v), axis=-1)

    def rays(self, pixels: Array) -> Array:
        """Rays (..., 6) [m] in the recording's frame, scaled so that the hit distance is depth."""
        directions = np.ones((*pixels.shape[:-1], 3))
        directions[..., :2] = (pixels - self.center) / self.focal
        directions = directions @ self.pose[:3, :3].T
        origins = np.broadcast_to(self.pose[:3, 3], directions.shape)
        return np.concatenate([origins, directions], axis=-1)


@dataclass(frozen=True)
class Hits:
    """What rays met: depth [m] (inf for nothing), unit normals, index of the mesh (−1: none)."""

    depth: Array
    normals: Array
    mesh: Array


def looking_at(position: Array, target: Array) -> Array:
    """Pose (4, 4) of a level camera at ``position`` [m] that looks at ``target`` [m]."""
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


class Scene:
    """Meshes to cast rays at, numbered in the order they are given."""

    def __init__(self, meshes: list[o3d.t.geometry.TriangleMesh]) -> None:
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=2)
        for mesh in meshes:
            self._scene.add_triangles(mesh)

    def cast(self, rays: Array) -> Hits:
        """First hits of ``rays`` (..., 6)."""
        found = self._scene.cast_rays(o3d.core.Tensor(rays.astype(np.float32)), nthreads=2)
        depth = found["t_hit"].numpy().astype(float)
        mesh = found["geometry_ids"].numpy().astype(int)
        normals = found["primitive_normals"].numpy().astype(float)
        # Meshes need not be wound alike: a seen surface faces its ray.
        normals *= -np.sign((normals * rays[..., 3:]).sum(-1, keepdims=True))
        return Hits(depth, normals, np.where(np.isfinite(depth), mesh, -1))

    def shadowed(self, points: Array, light: Array) -> Array:
        """Which ``points`` (..., 3) [m] do not see a light in direction ``light``."""
        rays = np.concatenate([points, np.broadcast_to(light, points.shape)], axis=-1)
        tensor = o3d.core.Tensor(rays.astype(np.float32))
        return self._scene.test_occlusions(tensor, tnear=2e-3, nthreads=2).numpy()


def box(center: Array, size: Array) -> o3d.t.geometry.TriangleMesh:
    """An axis-aligned box; ``center`` and ``size`` (3,) in metres."""
    width, height, depth = (float(value) for value in size)
    mesh = o3d.t.geometry.TriangleMesh.create_box(width, height, depth)
    corner = np.asarray(center) - 0.5 * np.asarray(size)
    return mesh.translate(o3d.core.Tensor(corner.astype(np.float32)))


def tube(nodes: Array, arc_length: Array, radius: float) -> o3d.t.geometry.TriangleMesh:
    """A tube with rounded ends around ``nodes`` (n, 3) at ``arc_length`` (n,); all in metres."""
    curve = CubicSpline(arc_length, nodes)
    stations = np.linspace(arc_length[0], arc_length[-1], RINGS)
    centers, tangents = curve(stations), curve(stations, 1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)

    # A half sphere is more rings of shrinking radius, pushed outwards.
    angles = np.radians([20.0, 40.0, 60.0, 75.0, 89.0])
    push = radius * np.sin(angles)[:, None]
    centers = np.vstack([centers[0] - push[::-1] * tangents[0], centers,
                         centers[-1] + push * tangents[-1]])  # fmt: skip
    shrunk = radius * np.cos(angles)
    radii = np.concatenate([shrunk[::-1], np.full(RINGS, radius), shrunk])
    tangents = np.pad(tangents, ((len(angles), len(angles)), (0, 0)), mode="edge")

    # The ropes run near the plane y = 0, so the y axis is never along one.
    normals = np.cross(tangents, [0.0, 1.0, 0.0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    binormals = np.cross(tangents, normals)
    around = np.linspace(0, 2 * np.pi, RING_SIDES, endpoint=False)[None, :, None]
    outward = np.cos(around) * normals[:, None] + np.sin(around) * binormals[:, None]
    vertices = centers[:, None] + radii[:, None, None] * outward

    ring, side = np.meshgrid(np.arange(len(radii) - 1), np.arange(RING_SIDES), indexing="ij")
    corner = ring * RING_SIDES + side
    beside = ring * RING_SIDES + (side + 1) % RING_SIDES
    above, diagonal = corner + RING_SIDES, beside + RING_SIDES
    triangles = np.stack([[corner, beside, above], [beside, diagonal, above]])
    triangles = np.moveaxis(triangles, 1, -1).reshape(-1, 3)
    return o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(vertices.reshape(-1, 3).astype(np.float32)),
        o3d.core.Tensor(triangles.astype(np.int32)),
    )
