"""How the paper's ropes are moved, and their shapes at rest by simulators that are not ropefit's.

"mujoco": MuJoCo's discrete elastic rod, brought to rest (`benchmarks.discovery.mujoco_rope`).
"elastica": the rod's differential equations by collocation (`benchmarks.discovery.elastica`), for
ropes that stretch and for ends held differently, which MuJoCo's rod here cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from benchmarks.discovery.setting import FIXED_END, GJ_TO_EI, grasped
from benchmarks.paper.pipeline import MiddleTable, Rendered, RopeTable, SweepTable
from reference_simulators.kirchhoff_rod import CLAMPED, PINNED, Ends, facing, hang
from reference_simulators.rod_equations import Array, Rod, rotation

STATIONS = 1001  # of a centreline


@dataclass(frozen=True)
class Truth:
    """What the camera will look at: centrelines (T, N, 3) [m] at rest arc lengths (N,) [m].

    positions (T, 2, 3) [m] and orientations (T, 2, 4) of the ends; held: which are clamped;
    gripper (T, 3) [m] the control point.
    """

    arc: Array
    nodes: Array
    positions: Array
    orientations: Array
    held: tuple[bool, bool]
    gripper: Array


def shapes(recording: Rendered) -> Truth:
    """Solve the rope at rest in every frame. Raises RuntimeError or NotConverged."""
    if isinstance(recording.motion, MiddleTable):
        return _held_in_the_middle(recording.rope, recording.motion)
    held = sweep(recording.motion, recording.rope.length)
    return settled(recording.rope, held, recording.simulator)


def settled(rope: RopeTable, held: Ends, simulator: str) -> Truth:
    """Solve a rope held at its ends."""
    arc = np.linspace(0.0, rope.length, STATIONS)
    if simulator == "mujoco":
        from reference_simulators.mujoco_rope import shapes, tangents

        if not np.isinf(rope.EA):
            raise ValueError("MuJoCo's edges stretch by no rigidity; take elastica")
        s, x = shapes(rod_of(rope), held, rope.diameter)
        nodes = CubicHermiteSpline(s, x, tangents(s, x), axis=1)(arc)
        orientations = held.orientations
    else:
        nodes, orientations = _by_elastica(rod_of(rope), held, arc)
    clamped = (held.kinds[0] == CLAMPED, held.kinds[1] == CLAMPED)
    return Truth(arc, nodes, held.positions, orientations, clamped, held.positions[:, 0])


def _by_elastica(rod: Rod, held: Ends, arc: Array) -> tuple[Array, Array]:
    problem, y = hang(rod, held)
    stretch = 1 + rod.compliance * (y[..., 7:10] * rotation(y[..., 3:7])[..., 2]).sum(-1)
    slope = stretch[..., None] * rotation(y[..., 3:7])[..., 2]
    nodes = CubicHermiteSpline(problem.mesh, y[..., :3], slope, axis=1)(arc)
    return nodes, grasped(held, y).orientations


def rod_of(rope: RopeTable) -> Rod:
    """Return the rope as the simulators want it."""
    compliance = 0.0 if np.isinf(rope.EA) else 1 / rope.EA
    return Rod(
        rope.length, rope.mass / rope.length, rope.EI, GJ_TO_EI * rope.EI, compliance=compliance
    )


def sweep(motion: SweepTable, length: float) -> Ends:
    """Return end poses (T frames) of a control point that moves away from end 1 and returns."""
    phase = np.linspace(0.0, 2 * np.pi, motion.frames)
    near, far = motion.distance
    if far > length:
        raise ValueError("distance: farther than the rope is long")
    distance = near + (far - near) * 0.5 * (1 - np.cos(phase))
    # Seen from end 1, so that the distance stays as wanted.
    elevation = np.radians(motion.elevation) * (0.7 * np.sin(phase) + 0.3 * np.sin(2 * phase + 0.6))
    azimuth = np.radians(motion.azimuth) * np.cos(phase + 0.8)
    positions = np.stack(
        [
            FIXED_END - distance[:, None] * directions(-elevation, -azimuth),
            np.tile(FIXED_END, (motion.frames, 1)),
        ],
        axis=1,
    )
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (motion.frames, 2, 1))
    for end, angles in enumerate((motion.gripper, motion.post)):
        if angles is None:
            continue
        swing = motion.swing if end == 0 else (0.0, 0.0)
        pitch = angles[0] + swing[0] * np.sin(phase + 1.0)
        yaw = angles[1] + swing[1] * np.sin(phase + 0.3)
        turns[:, end] = oriented(directions(np.radians(pitch), np.radians(yaw)))
    kinds = tuple(PINNED if a is None else CLAMPED for a in (motion.gripper, motion.post))
    return Ends(positions, turns, (kinds[0], kinds[1]))


def directions(pitch: Array, yaw: Array) -> Array:
    """Return unit vectors (T, 3) from angles (T,) [rad] of elevation and azimuth."""
    flat = np.cos(pitch)
    return np.stack([flat * np.cos(yaw), flat * np.sin(yaw), np.sin(pitch)], axis=-1)


def oriented(tangents: Array) -> Array:
    """Return (T, 4) quaternions w, x, y, z whose third axes are the tangents (T, 3)."""
    return np.stack([np.roll(facing(tangent).as_quat(), 1) for tangent in tangents])


def _held_in_the_middle(rope: RopeTable, motion: MiddleTable) -> Truth:
    """Solve two ropes that meet in a gripper, which holds direction and place.

    End 0 is at the origin, end 1 at (span, 0, 0).
    """
    phase = np.linspace(0.0, 2 * np.pi, motion.frames, endpoint=False)
    wave = np.stack([np.sin(phase), np.sin(phase + 1.2), np.sin(2 * phase + 0.5)], axis=1)
    grip = np.asarray(motion.centre) + np.asarray(motion.reach) * wave
    ends = (np.zeros(3), np.array([motion.span, 0.0, 0.0]))
    level = oriented(np.tile([1.0, 0.0, 0.0], (motion.frames, 1)))
    free = np.tile([1.0, 0.0, 0.0, 0.0], (motion.frames, 1))
    parts = []
    for side, length in enumerate((motion.at, rope.length - motion.at)):
        part = rope.model_copy(update={"length": length, "mass": rope.mass * length / rope.length})
        far = np.tile(ends[side], (motion.frames, 1))
        pair, turns = (far, grip), (free, level)
        if side == 1:
            pair, turns = pair[::-1], turns[::-1]
        kinds = (PINNED, CLAMPED) if side == 0 else (CLAMPED, PINNED)
        held = Ends(np.stack(pair, axis=1), np.stack(turns, axis=1), kinds)
        parts.append(settled(part, held, "elastica"))
    first, second = parts
    return Truth(
        np.concatenate([first.arc, motion.at + second.arc[1:]]),
        np.concatenate([first.nodes, second.nodes[:, 1:]], axis=1),
        np.stack([np.tile(end, (motion.frames, 1)) for end in ends], axis=1),
        np.stack([free, free], axis=1),
        (False, False),
        grip,
    )
