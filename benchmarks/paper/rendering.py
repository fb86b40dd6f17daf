"""The set-ups before a depth camera: a rope, a gripper that hides part of it, a post, a wall.

Ray casting, light and the faults of the sensor are those of `benchmarks.perception.rendered`, in
the camera's own axes.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.perception.rendered import HEIGHT, WIDTH, box, camera, rays, sensed, shaded, tube
from ropefit.perception.camera import Camera

Array = np.ndarray
BLUR = 0.6  # px, of the lens
FINE = 4001  # points of the curve that a tube is laid around
BAND = 0.008  # m, length of a mark
RED = (0.75, 0.05, 0.05)
JAW, WALL = (0.10, 0.10, 0.11), (0.62, 0.62, 0.60)


Box = tuple[Array, Array, tuple[float, float, float]]  # centre, size [m], colour


def looking(position: tuple[float, ...], target: tuple[float, ...]) -> Camera:
    """Return a level camera at `position` [m] that looks at `target` [m]."""
    ahead = np.subtract(target, position)
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose, eye = np.eye(4), camera()
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    pose[:3, 3] = position
    return Camera(WIDTH, HEIGHT, eye.fx, eye.fy, eye.cx, eye.cy, pose)


def baxter_gripper(tip: Array) -> list[Box]:
    """Return the hand and two jaws about the rope's end, which hide 3 to 4 cm of it."""
    jaw = np.array([0.070, 0.070, 0.018])
    return [
        (tip + np.array([0, 0, -0.022]), jaw, JAW),
        (tip + np.array([0, 0, 0.022]), jaw, JAW),
        (tip + np.array([0, -0.085, 0]), np.array([0.08, 0.10, 0.09]), JAW),
    ]


def wall(behind: float) -> list[Box]:
    """Return a wall across the picture, at a distance [m]: every ray must end somewhere."""
    return [(np.array([0.0, 0.0, behind + 0.01]), np.array([8.0, 8.0, 0.02]), WALL)]


def post(tip: Array) -> list[Box]:
    """Return the post that holds the other end, behind the rope."""
    return [(tip + np.array([0.012, 0, 0.03]), np.array([0.024, 0.04, 0.04]), (0.30, 0.31, 0.33))]


def needle_driver(tip: Array, radius: float) -> list[Box]:
    """Return a thin tool from above that holds the rope from behind: nothing of it is hidden."""
    return [(tip + np.array([0, -0.05, radius + 0.012]), np.array([0.006, 0.11, 0.006]), JAW)]


def frame(
    arc: Array,
    nodes: Array,
    radius: float,
    color: tuple[float, float, float],
    marks: list[float],
    boxes: list[Box],
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Render a rope: return color (H, W, 3) uint8 and depth (H, W) [m].

    The centreline (n, 3) [m] in the camera's axes, at arc lengths (n,) [m]; marks: arc lengths of
    red bands.
    """
    import open3d

    o3d: Any = open3d  # its stubs miss what its constructors take
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    s = np.linspace(arc[0], arc[-1], FINE)
    curve = CubicSpline(arc, nodes)(s)
    scene.add_triangles(tube(s, curve, radius))
    colors = [np.array(color)]
    for mark in marks:
        band = np.linspace(mark - BAND / 2, mark + BAND / 2, 201)
        scene.add_triangles(tube(band, CubicSpline(arc, nodes)(band), 1.04 * radius))
        colors.append(np.array(RED))
    for centre, size, shade in boxes:
        scene.add_triangles(box(centre, size))
        colors.append(np.array(shade))
    grid = rays(np.arange(WIDTH), np.arange(HEIGHT))
    image = cv2.GaussianBlur(shaded(scene, np.array(colors), grid, rng), (0, 0), BLUR)
    hit = scene.cast_rays(o3d.core.Tensor(grid), nthreads=1)
    return image, sensed(hit["t_hit"].numpy().astype(float), rng)
