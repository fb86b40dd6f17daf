"""From where a rope is looked at: the recording's camera, and the eye of a figure in space."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Observations, View
from ropefit.perception.camera import downwards

ASIDE, ABOVE = 0.4, 0.25  # tangents of the angles from which a figure in space is looked at


def project(view: View, x: np.ndarray) -> np.ndarray:
    """Return (..., 2) [px] of points x (..., 3) [m]; NaN behind the camera."""
    local = (x - view.pose[:3, 3]) @ view.pose[:3, :3]
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = np.where(local[..., 2] > 1e-9, local[..., 2], np.nan)
        u = view.fx * local[..., 0] / depth + view.cx
        v = view.fy * local[..., 1] / depth + view.cy
    return np.stack([u, v], axis=-1)


def upwards(o: Observations) -> np.ndarray:
    """Return (3,) the unit vector against gravity."""
    return -downwards(o.gravity)


def broadside(o: Observations, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (eye (3,), up (3,)): from where points x (..., 3) [m] spread most across the view, on
    the camera's side, and somewhat from above and aside: what goes into the depth shows, too."""
    up, flat = upwards(o), x.reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1)]
    level = (flat - flat.mean(axis=0)) @ (np.eye(3) - np.outer(up, up))
    along = np.linalg.svd(level[:: max(1, len(level) // 2000)], full_matrices=False)[2][0]
    eye = np.cross(along - (along @ up) * up, up)
    size = np.linalg.norm(eye)
    eye = eye / size if size > 1e-9 else np.roll(up, 1)
    away = o.view.pose[:3, 3] - flat.mean(axis=0)
    eye = eye if eye @ away >= 0 else -eye
    return eye + ASIDE * np.cross(up, eye) + ABOVE * up, up


def image_name(view: View) -> str:
    """Return what the image plane is."""
    if view.virtual:
        return "The recording has no camera: a virtual one was assumed for this view."
    return f"The image is {view.width} × {view.height} px."
