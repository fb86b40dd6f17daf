"""Pinhole cameras in numpy, and the virtual one of recordings that have none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Camera:
    """Intrinsics [px] and pose (4, 4) recording <- camera, OpenCV axes (x right, y down, z
    ahead)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    pose: np.ndarray
    virtual: bool = False

    def local(self, points: np.ndarray) -> np.ndarray:
        """Return (N, 3) [m] points in the camera's axes."""
        return (points - self.pose[:3, 3]) @ self.pose[:3, :3]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return (N, 2) [px]; not finite where a point lies in the plane of the camera."""
        local = self.local(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            return local[:, :2] / local[:, 2:] * [self.fx, self.fy] + [self.cx, self.cy]

    def unproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return (N, 3) [m] points in the recording's frame of pixels (N, 2) at depth (N,) [m]."""
        rays = (pixels - [self.cx, self.cy]) / [self.fx, self.fy]
        local = np.column_stack([rays * depth[:, None], depth])
        return local @ self.pose[:3, :3].T + self.pose[:3, 3]

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Return (N, 3) unit directions in the recording's frame."""
        ahead = self.unproject(pixels, np.ones(len(pixels))) - self.pose[:3, 3]
        return ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def downwards(gravity: np.ndarray) -> np.ndarray:
    """Return (3,) the unit vector along gravity (3,) [m/s²], against z where there is none."""
    size = float(np.linalg.norm(gravity))
    return gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])


def virtual_camera(points: np.ndarray, gravity: np.ndarray, viewpoint: np.ndarray | None) -> Camera:
    """Return a 1280 x 720 camera of focal length 610 px that looks at points (N, 3) [m].

    It stands at the viewpoint if that is known; else it faces the plane in which the points spread
    most widely, far enough away to see all of them.
    """
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    spread = points - points.mean(axis=0)
    extent = max(float(np.linalg.norm(points - centre, axis=1).max()), 1e-6)
    if viewpoint is None:
        least = np.linalg.svd(spread, full_matrices=False)[2][-1]
        viewpoint = centre - 2.0 * extent * least  # half the height of the image is 0.59 of 610 px
    ahead = centre - viewpoint
    distance = np.linalg.norm(ahead)
    ahead = ahead / distance if distance > 1e-9 else np.array([0.0, 1.0, 0.0])
    down = downwards(gravity)
    right = np.cross(down, ahead)
    if np.linalg.norm(right) < 1e-6:  # looking straight down or up
        right = np.cross(np.eye(3)[int(np.argmin(np.abs(ahead)))], ahead)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(ahead, right), ahead])
    pose[:3, 3] = viewpoint
    return Camera(1280, 720, 610.0, 610.0, 640.0, 360.0, pose, virtual=True)
