"""Colour and depth images of the rope on a small set with a gripper and a post."""

from pathlib import Path

import cv2
import numpy as np

from generator.motions import FIXED_END
from generator.recording import Truth
from generator.rope import Array
from generator.scene import Camera, Hits, Scene, box, looking_at, tube

CAMERA = Camera(
    640, 360, 560.0, looking_at(np.array([-0.03, -1.18, 0.54]), np.array([-0.05, 0.0, 0.45]))
)
SUPERSAMPLE = 2
LIGHT = np.array([-0.45, -0.70, 0.90]) / np.linalg.norm([-0.45, -0.70, 0.90])
AMBIENT = 0.55
# Linear-ish RGB in 0…1, in the order of _scene: only the rope is saturated.
COLORS = np.array(
    [
        [0.95, 0.30, 0.07],  # rope
        [0.45, 0.48, 0.50],  # table
        [0.80, 0.81, 0.78],  # wall
        [0.10, 0.10, 0.11],  # gripper: two jaws and the hand behind them
        [0.10, 0.10, 0.11],
        [0.16, 0.16, 0.17],
        [0.50, 0.52, 0.55],  # post and its clamp
        [0.30, 0.31, 0.33],
    ]
)
TEXTURED = (1, 2)
SENSOR_NOISE = 1.2  # grey levels, sd
AXIAL_NOISE = 0.001  # m, sd at 1 m, grows with depth squared
EDGE_STEP = 0.03  # m, a depth difference between neighbours that makes flying pixels
FLYING = 0.25  # share of edge pixels between foreground and background
EDGE_DROPOUT, DROPOUT = 0.10, 0.003  # share of edge pixels and of all pixels without depth
HOLES = 4  # blobs without depth in a frame


def write_images(folder: Path, truth: Truth, rng: np.random.Generator) -> str:
    """Write ``color/*.png`` and ``depth/*.png`` and return the ``[rgbd]`` table."""
    (folder / "color").mkdir()
    (folder / "depth").mkdir()
    texture = _texture(rng)
    for frame, nodes in enumerate(truth.nodes):
        scene = _scene(nodes, truth)
        name = f"{frame:06d}.png"
        cv2.imwrite(str(folder / "color" / name), _color(scene, texture, rng)[..., ::-1])
        cv2.imwrite(str(folder / "depth" / name), _depth(scene, rng))
    rows = ",\n".join("  [" + ", ".join(f"{x:.9f}" for x in row) + "]" for row in CAMERA.pose)
    cx, cy = CAMERA.center
    intrinsics = (
        f"{{ width = {CAMERA.width}, height = {CAMERA.height}, "
        f"fx = {CAMERA.focal}, fy = {CAMERA.focal}, cx = {cx}, cy = {cy} }}"
    )
    return f"""[rgbd]
color = "color/{{frame:06d}}.png"
depth = "depth/{{frame:06d}}.png"
depth_scale = 0.001
intrinsics = {intrinsics}
camera_pose = [
{rows},
]
"""


def _scene(nodes: Array, truth: Truth) -> Scene:
    grip = nodes[0]
    return Scene(
        [
            tube(nodes, truth.arc_length, 0.5 * truth.rope.diameter),
            box(np.array([0.0, 0.0, -0.02]), np.array([3.0, 0.9, 0.04])),
            box(np.array([0.0, 0.47, 0.8]), np.array([4.0, 0.04, 2.4])),
            # The jaws hide the rope from front and back for 3–5 cm; a rope that leaves them
            # askew must not cut through one.
            box(grip + np.array([0.0, -0.022, 0.004]), np.array([0.075, 0.020, 0.075])),
            box(grip + np.array([0.0, 0.022, 0.004]), np.array([0.075, 0.020, 0.075])),
            box(grip + np.array([0.0, 0.0, 0.080]), np.array([0.085, 0.080, 0.080])),
            box(
                FIXED_END * [1, 1, 0.5] + [0.022, 0.0, 0.02],
                np.array([0.030, 0.030, FIXED_END[2] + 0.04]),
            ),
            box(FIXED_END + np.array([0.012, 0.0, 0.0]), np.array([0.024, 0.040, 0.024])),
        ]
    )


def _texture(rng: np.random.Generator) -> Array:
    """Fixed brightness pattern of the background, mean 1, on the supersampled grid."""
    shape = (CAMERA.height * SUPERSAMPLE, CAMERA.width * SUPERSAMPLE)
    pattern = np.ones(shape)
    for width, amplitude in ((1.5, 0.010), (8.0, 0.015), (60.0, 0.030)):
        layer = cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), width)
        pattern += amplitude * layer / layer.std()
    return pattern


def _color(scene: Scene, texture: Array, rng: np.random.Generator) -> Array:
    """An antialiased RGB image (height, width, 3), uint8."""
    rays = CAMERA.rays(CAMERA.pixels(SUPERSAMPLE))
    hits = scene.cast(rays)
    points = rays[..., :3] + hits.depth[..., None] * rays[..., 3:]
    lit = ~scene.shadowed(points + 1e-3 * hits.normals, LIGHT)
    diffuse = np.clip(hits.normals @ LIGHT, 0.0, 1.0) * np.where(lit, 1.0, 0.35)
    brightness = AMBIENT + (1 - AMBIENT) * diffuse
    brightness *= 1.05 - 0.18 * np.clip(points[..., 0], -1, 1)  # the lamp stands to the left
    brightness *= np.where(np.isin(hits.mesh, TEXTURED), texture, 1.0)
    image = 255 * COLORS[hits.mesh] * brightness[..., None]
    size = (CAMERA.width, CAMERA.height)
    image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    image += SENSOR_NOISE * rng.standard_normal(image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def _depth(scene: Scene, rng: np.random.Generator) -> Array:
    """A depth image (height, width) in mm, uint16, 0 where there is none."""
    hits: Hits = scene.cast(CAMERA.rays(CAMERA.pixels()))
    depth = hits.depth
    kernel = np.ones((3, 3), np.uint8)
    near, far = cv2.erode(depth, kernel), cv2.dilate(depth, kernel)
    edge = far - near > EDGE_STEP
    flying = edge & (rng.random(depth.shape) < FLYING)
    depth = np.where(flying, near + (far - near) * rng.random(depth.shape), depth)
    depth = depth + AXIAL_NOISE * depth**2 * rng.standard_normal(depth.shape)
    lost = rng.random(depth.shape) < np.where(edge, EDGE_DROPOUT, DROPOUT)
    holes = np.zeros(depth.shape, np.uint8)
    for _ in range(HOLES):
        middle = rng.integers((0, 0), (CAMERA.width, CAMERA.height)).tolist()
        axes = rng.integers(3, 9, 2).tolist()
        cv2.ellipse(holes, middle, axes, float(rng.uniform(0, 180)), 0, 360, 1, -1)
    depth[lost | (holes == 1)] = 0.0
    return np.round(1000 * depth).astype(np.uint16)
