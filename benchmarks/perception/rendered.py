"""Rendered RGB-D frames of known ropes: clutter, a shadow, a crossing, hidden stretches, and the
faults of a depth camera. Ray casting by open3d; shapes are smooth curves, not ropefit's mechanics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree

from ropefit.perception.camera import Camera

WIDTH, HEIGHT, FOCAL = 1280, 720, 610.0  # px, as an Azure Kinect's colour camera at 720p
DISTANCE = 0.75  # m, camera to rope
LENGTH = 1.0  # m
AXIAL = 0.0017  # m, sd of a depth pixel, as the maker gives for its noise
EDGE, FLYING, LOST = 0.02, 0.35, 0.12  # m; shares of edge pixels that fly and that are lost
DROPOUT = 0.003  # share of all depth pixels that are lost
HIDDEN = 0.2  # share of the rope behind other things
SENSOR = 1.5  # grey levels, sd
LIGHT = np.array([-0.4, -0.5, -0.75]) / np.linalg.norm([-0.4, -0.5, -0.75])  # towards the lamp


@dataclass(frozen=True)
class Kind:
    """One rope: colour (r, g, b) 0..1, diameter [m]."""

    name: str
    color: tuple[float, float, float]
    diameter: float


ROPES = (
    Kind("orange", (0.90, 0.38, 0.08), 0.008),
    Kind("blue", (0.08, 0.22, 0.70), 0.006),
    Kind("white", (0.93, 0.93, 0.91), 0.010),
    Kind("black", (0.04, 0.04, 0.05), 0.005),
    Kind("green", (0.10, 0.45, 0.15), 0.012),
    Kind("red", (0.65, 0.05, 0.08), 0.004),
)


@dataclass(frozen=True)
class Frame:
    """color (H, W, 3) uint8, depth (H, W) [m], curve (N, 3) [m] at arc (N,), hidden (N,) bool,
    crossing (2,) [m] arc lengths at which the rope crosses itself in the picture, or None."""

    color: np.ndarray
    depth: np.ndarray
    curve: np.ndarray
    arc: np.ndarray
    hidden: np.ndarray
    crossing: tuple[float, float] | None


def _open3d() -> Any:
    """Return open3d, untyped: its stubs miss what its constructors take."""
    import open3d

    return open3d


def camera() -> Camera:
    """Return the camera all frames are seen with; the recording's axes are its own."""
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5, np.eye(4))


def shape(rng: np.random.Generator, loop: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return (arc (N,), curve (N, 3)) [m] of a smooth rope of LENGTH before the camera.

    With a loop it crosses itself once in the picture.
    """
    s = np.linspace(0, 1, 4001)
    for _ in range(1000):
        # Heading along the rope: a sum of slow waves, and once around for a loop.
        angle = rng.uniform(-0.5, 0.5)
        for k in (1, 2, 3):
            angle = angle + rng.uniform(-0.9, 0.9) / k * np.sin(k * np.pi * s + rng.uniform(0, 6.3))
        if loop:
            middle, spread = rng.uniform(0.4, 0.6), rng.uniform(0.14, 0.18)
            angle = angle + rng.choice([-1, 1]) * 2 * np.pi / (
                1 + np.exp(-(s - middle) / spread * 4)
            )
        lean = 0.35 * np.sin(2 * np.pi * s * rng.uniform(0.4, 1.2) + rng.uniform(0, 6.3))
        step = np.column_stack([np.cos(angle), np.sin(angle), lean])
        step /= np.linalg.norm(step, axis=1, keepdims=True)
        curve = np.concatenate([[[0, 0, 0]], np.cumsum((step[1:] + step[:-1]) / 2, axis=0)])
        curve *= LENGTH / 4000
        curve -= (curve.min(axis=0) + curve.max(axis=0)) / 2
        curve[:, 2] += DISTANCE
        if loop:  # one strand passes before the other, not through it
            curve[:, 2] += 0.03 * np.tanh((s - middle) / 0.1)
        pixels = camera().project(curve)
        inside = (pixels > 40).all() and (pixels < [WIDTH - 40, HEIGHT - 40]).all()
        meets = crossings(pixels)
        if inside and len(meets) == (1 if loop else 0):
            return _by_length(curve)
    raise RuntimeError("no shape fits the picture")


def _by_length(curve: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)]), curve


def crossings(pixels: np.ndarray, near: float = 30.0) -> list[tuple[int, int]]:
    """Return index pairs at which a path (N, 2) [px] comes within `near` of itself, one a place."""
    thin = pixels[::10]
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(thin, axis=0), axis=1))])
    pairs = KDTree(thin).query_pairs(near, output_type="ndarray")
    pairs = pairs[np.abs(arc[pairs[:, 0]] - arc[pairs[:, 1]]) > 4 * near]
    places: list[tuple[int, int]] = []
    for a, b in pairs[np.argsort(np.linalg.norm(thin[pairs[:, 0]] - thin[pairs[:, 1]], axis=1))]:
        at = thin[a]
        if all(np.linalg.norm(at - thin[p // 10]) > 4 * near for p, _ in places):
            places.append((int(10 * a), int(10 * b)))
    return places


def render(kind: Kind, rng: np.random.Generator, loop: bool) -> Frame:
    """Render one frame of a rope among clutter."""
    o3d = _open3d()

    arc, curve = shape(rng, loop)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    colors = [np.array(kind.color)]
    scene.add_triangles(tube(arc, curve, kind.diameter / 2))
    meets = crossings(camera().project(curve))
    hidden_arc = _hidden(rng, arc, [arc[i] for pair in meets for i in pair])
    for low, high in hidden_arc:
        # Things in the way: boxes half-way to the camera, as long as the stretch that they hide.
        inside = curve[(arc >= low) & (arc <= high)]
        middle = inside.mean(axis=0) * 0.8
        size = float(np.linalg.norm(np.ptp(inside, axis=0))) * 0.8
        scene.add_triangles(box(middle, [0.75 * size, 0.75 * size, 0.02]))
        colors.append(np.array([0.35, 0.33, 0.36]) + rng.uniform(-0.05, 0.05, 3))
    ground = np.array([0.52, 0.50, 0.47])
    scene.add_triangles(box([0, 0, DISTANCE + 0.33], [6, 6, 0.02]))
    colors.append(ground)
    for _ in range(5):  # clutter on the ground
        place = [rng.uniform(-0.8, 0.8), rng.uniform(-0.45, 0.45), DISTANCE + 0.28]
        scene.add_triangles(box(place, rng.uniform([0.03, 0.03, 0.02], [0.2, 0.15, 0.08])))
        colors.append(rng.uniform(0.25, 0.75) * np.array([1, 1, 1]) + rng.uniform(-0.06, 0.06, 3))
    u, v = (np.arange(2 * WIDTH) + 0.5) / 2 - 0.5, (np.arange(2 * HEIGHT) + 0.5) / 2 - 0.5
    color = shaded(scene, np.array(colors), rays(u, v), rng)
    hit = scene.cast_rays(o3d.core.Tensor(rays(np.arange(WIDTH), np.arange(HEIGHT))), nthreads=1)
    truth = hit["t_hit"].numpy().astype(float)
    pixels = np.round(camera().project(curve)).astype(int)
    front = truth[pixels[:, 1], pixels[:, 0]] < curve[:, 2] - 0.04  # something stands before it
    crossing = (float(arc[meets[0][0]]), float(arc[meets[0][1]])) if meets else None
    return Frame(color, sensed(truth, rng), curve, arc, front, crossing)


def _hidden(
    rng: np.random.Generator, arc: np.ndarray, keep: list[float]
) -> list[tuple[float, float]]:
    """Return two stretches, together HIDDEN of the rope, away from its ends and crossings."""
    out: list[tuple[float, float]] = []
    for _ in range(1000):
        size = HIDDEN / 2 * arc[-1] * 0.8
        low = rng.uniform(0.08, 0.92 - HIDDEN / 2) * arc[-1]
        clear = all(not low - 0.07 < at < low + size + 0.07 for at in keep)
        if clear and all(abs(low - other) > size + 0.08 for other, _ in out):
            out.append((low, low + size))
        if len(out) == 2:
            break
    return out


def rays(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    eye = camera()
    grid = np.stack(np.meshgrid((u - eye.cx) / eye.fx, (v - eye.cy) / eye.fy), axis=-1)
    ones = np.ones((*grid.shape[:2], 1))
    return np.concatenate([np.zeros((*grid.shape[:2], 3)), grid, ones], axis=-1).astype(np.float32)


def shaded(scene, colors: np.ndarray, rays: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the picture (H, W, 3) uint8: with cast shadows, ground texture and sensor noise."""
    o3d = _open3d()

    hit = scene.cast_rays(o3d.core.Tensor(rays), nthreads=1)
    depth, mesh = hit["t_hit"].numpy(), hit["geometry_ids"].numpy().astype(int)
    normal = hit["primitive_normals"].numpy()
    normal = normal * -np.sign((normal * rays[..., 3:]).sum(-1, keepdims=True))
    at = rays[..., 3:] * depth[..., None] + 2e-3 * normal
    towards = np.broadcast_to(LIGHT, at.shape)
    shade = scene.test_occlusions(
        o3d.core.Tensor(np.concatenate([at, towards], -1).astype(np.float32)), nthreads=1
    ).numpy()
    lit = np.clip(normal @ LIGHT, 0, 1) * np.where(shade, 0.25, 1.0)
    bright = 0.55 + 0.5 * lit
    pattern = gaussian_filter(rng.standard_normal(mesh.shape), 3.0)
    bright *= np.where(mesh > 0, 1 + 0.03 * pattern / pattern.std(), 1.0)
    image = 255 * colors[np.clip(mesh, 0, len(colors) - 1)] * bright[..., None]
    image = cv2.resize(image, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    image += SENSOR * rng.standard_normal(image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def sensed(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return depths (H, W) [m] as a depth camera gives them: noise, flying pixels, losses."""
    kernel = np.ones((3, 3), np.uint8)
    near, far = cv2.erode(depth, kernel), cv2.dilate(depth, kernel)
    edge = far - near > EDGE
    fly = edge & (rng.random(depth.shape) < FLYING)
    out = np.where(fly, near + (far - near) * rng.random(depth.shape), depth)
    out = out + AXIAL * rng.standard_normal(depth.shape)
    out[rng.random(depth.shape) < np.where(edge, LOST, DROPOUT)] = 0.0
    return np.round(out * 1000) / 1000


def box(center, size):
    o3d = _open3d()

    mesh = o3d.t.geometry.TriangleMesh.create_box(*(float(value) for value in size))
    corner = (np.asarray(center) - np.asarray(size) / 2).astype(np.float32)
    return mesh.translate(o3d.core.Tensor(corner))


def tube(arc: np.ndarray, curve: np.ndarray, radius: float, rings: int = 800, sides: int = 24):
    o3d = _open3d()

    spline = CubicSpline(arc[::20], curve[::20])
    s = np.linspace(arc[0], arc[-1], rings)
    center, tangent = spline(s), spline(s, 1)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    one = np.cross(tangent, [0.0, 0.0, 1.0])
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    two = np.cross(tangent, one)
    turn = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :, None]
    ring = center[:, None] + radius * (np.cos(turn) * one[:, None] + np.sin(turn) * two[:, None])
    k, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a, b = k * sides + j, k * sides + (j + 1) % sides
    faces = np.stack([np.stack([a, b, a + sides], -1), np.stack([b, b + sides, a + sides], -1)])
    return o3d.t.geometry.TriangleMesh(
        o3d.core.Tensor(ring.reshape(-1, 3).astype(np.float32)),
        o3d.core.Tensor(faces.reshape(-1, 3).astype(np.int32)),
    )
