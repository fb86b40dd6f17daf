"""How the control point moves in each recording: smooth paths, one pose a frame."""

import numpy as np

from generator.rope import Array, EndPoses

FIXED_END = np.array([0.40, 0.0, 0.60])  # m, end 1 of every recording


def out_and_back(
    frames: int, length: float, *, closest: float = 0.35, farthest: float = 0.97
) -> list[EndPoses]:
    """Pinned ends; end 0 goes from a strongly bent rope to an almost taut one and returns.

    ``length`` [m] of the rope; ``closest`` and ``farthest`` are end distances over it. The way back
    is lower and on the other side of the plane than the way out, so no pose comes twice.
    """
    phase = np.linspace(0.0, 1.0, frames)
    bump = 0.5 * (1 - np.cos(2 * np.pi * phase))
    distance = length * (closest + (farthest - closest) * bump)
    # Sideways and vertical parts are angles seen from end 1: the distance stays as wanted.
    elevation = 0.25 * np.sin(2 * np.pi * phase) + 0.10 * np.sin(4 * np.pi * phase + 0.6)
    azimuth = 0.05 * np.cos(2 * np.pi * phase + 0.8) + 0.02
    return [
        EndPoses(np.stack([FIXED_END + d * direction, FIXED_END]))
        for d, direction in zip(distance, _directions(azimuth, elevation), strict=True)
    ]


def swept_poses(frames: int, length: float) -> list[EndPoses]:
    """Pinned ends; separate poses for the camera, up to about 12° out of the plane y = 0.

    ``length`` [m] of the rope.
    """
    phase = np.linspace(0.0, 1.0, frames)
    distance = length * np.interp(phase, [0, 0.5, 1], [0.40, 0.80, 0.95])
    elevation = 0.15 * np.cos(3 * np.pi * phase) - 0.03
    azimuth = np.radians(12.0) * np.sin(2 * np.pi * phase + 0.5)
    return [
        EndPoses(np.stack([FIXED_END + d * direction, FIXED_END]))
        for d, direction in zip(distance, _directions(azimuth, elevation), strict=True)
    ]


def swung_clamp(frames: int, length: float) -> list[EndPoses]:
    """Clamped ends; end 0 translates (all three axes) and turns in pitch and yaw.

    ``length`` [m] of the rope.
    """
    phase = 2 * np.pi * np.linspace(0.0, 1.0, frames)
    distance = length * (0.66 - 0.24 * np.cos(phase) + 0.05 * np.sin(3 * phase))
    elevation = 0.25 * np.sin(2 * phase)
    azimuth = 0.18 * np.sin(phase + 0.3)
    pitch = np.radians(-25.0 + 30.0 * np.sin(phase + 1.0))  # below the horizontal when negative
    yaw = np.radians(15.0 * np.sin(phase - 0.4))
    tangents = np.stack(
        [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=1
    )
    fixed_pitch = np.radians(20.0)
    fixed_tangent = np.array([np.cos(fixed_pitch), 0.0, np.sin(fixed_pitch)])
    return [
        EndPoses(np.stack([FIXED_END + d * direction, FIXED_END]), np.stack([t, fixed_tangent]))
        for d, direction, t in zip(distance, _directions(azimuth, elevation), tangents, strict=True)
    ]


def _directions(azimuth: Array, elevation: Array) -> Array:
    """Unit vectors (frames, 3) from end 1 to end 0; zero angles [rad] mean −x."""
    return np.stack(
        [
            -np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=1,
    )
