"""The camera of an imported recording stands still, or the import is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.numbers import rotation, vector

STILL, LEVEL = 0.01, 1.0  # m, degrees: what a pose estimate of a camera at rest may wander


def steady_pose(source: Path, poses: np.ndarray) -> np.ndarray:
    """Return (4, 4) the middle one of poses (F, 4, 4) recording <- camera. Raises BadInput if it
    moves."""
    middle = np.median(poses[:, :3, 3], axis=0)
    away = np.linalg.norm(poses[:, :3, 3] - middle, axis=1)
    pose = poses[int(np.argmin(away))]
    cosine = (np.einsum("fij,ij->f", poses[:, :3, :3], pose[:3, :3]) - 1) / 2
    turned = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    if away.max() > STILL or turned.max() > LEVEL:
        raise BadInput(
            f"{source}: the camera moves by {away.max():.3g} m and {turned.max():.3g} degrees; a "
            "recording has one camera pose, so import point clouds in a fixed frame instead"
        )
    return pose


def given_pose(text: str) -> np.ndarray:
    """Return (4, 4) recording <- camera from x,y,z,qx,qy,qz,qw. Raises WrongUsage."""
    value = vector("camera_pose", text, 7)
    length = float(np.linalg.norm(value[3:]))
    if abs(length - 1) > 0.01:
        raise WrongUsage("--set camera_pose: its quaternion is not of unit length")
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(np.roll(value[3:], 1) / length), value[:3]
    return pose
