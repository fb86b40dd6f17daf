"""How visible a change of shape is: its score after nominal and calibration nuisances.

Everything comes from the independent simulator; ropefit is not asked.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.discovery.clouds import CameraErrors, mistaken
from benchmarks.discovery.setting import (
    END_NOISE,
    INTERVAL,
    PRIORS,
    TILT_NOISE,
    Setting,
    World,
    moved,
    turned,
)
from reference_simulators import history_dependent_rod
from reference_simulators.collocation import derivatives
from reference_simulators.kirchhoff_rod import CLAMPED, RodProblem, follow
from reference_simulators.rod_equations import Array, rotation

STRETCHES = 30


def shapes(setting: Setting, world: World, start: Array | None = None) -> tuple[RodProblem, Array]:
    """Solve the changed world on the setting's mesh: return states (T, N + 1, 13)."""
    gauge = CLAMPED not in world.held.kinds and world.rod.isotropic
    goal = replace(setting.problem, rod=world.rod, held=world.held, gauge=gauge)
    if world.law is not None:
        plain = follow(lambda _: goal, setting.states)
        return goal, history_dependent_rod.shapes(goal, world.law, plain, INTERVAL)
    return goal, follow(lambda _: goal, setting.states if start is None else start)


@dataclass(frozen=True)
class Meter:
    """Whitened observation of small changes, and what the nuisances may do."""

    index: NDArray[np.int_]  # (P,) nearest mesh nodes of the stations
    basis: Array  # (T, P, 2, 3) directions across the rope over the noise [1/m]
    nuisances: Array  # (T * P * 2, C) whitened, times prior sd
    points: Array  # (T, P, 3) m

    def whitened(self, change: Array) -> Array:
        """Whiten changes (T, P, 3) [m]: return (T * P * 2,)."""
        return np.einsum("tpij,tpj->tpi", self.basis, change).ravel()

    def score(self, change: Array) -> float:
        """Return signal over noise of a change (T, P, 3) [m], nuisances marginalised."""
        z, b = self.whitened(change), self.nuisances
        inner = b.T @ z
        left = z @ z - inner @ np.linalg.solve(np.eye(b.shape[1]) + b.T @ b, inner)
        return float(np.sqrt(max(left, 0.0)))


def meter(setting: Setting) -> Meter:
    """Return the meter of one setting."""
    rod, held, problem, y = setting.rod, setting.held, setting.problem, setting.states
    stations = (np.arange(STRETCHES) + 0.5) * rod.length / STRETCHES
    index = np.abs(problem.mesh[:, None] - stations).argmin(axis=0)
    points, tangent = y[:, index, :3], rotation(y[:, index, 3:7])[..., 2]
    view = np.asarray(setting.sensor.viewpoint)
    ray = points - view
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray - (ray * tangent).sum(-1, keepdims=True) * tangent
    sine = np.linalg.norm(along, axis=-1, keepdims=True)
    along /= sine
    across = np.cross(tangent, along)
    each = setting.sensor.points / STRETCHES
    deep = setting.sensor.noise / np.sqrt(each)
    wide = max(0.25 * setting.diameter, setting.sensor.lateral) / np.sqrt(each)
    basis = np.stack([along / deep, across / wide], axis=2)

    # In every frame alike: EI, and EA of a rope that stretches; gravity, the ends; how large
    # everything is against the rope.
    small = 1e-4
    changed, sizes = [replace(problem, rod=replace(rod, bending=rod.bending * 1.001))], [3000.0]
    if rod.compliance:
        softer = replace(rod, compliance=rod.compliance * 1.001)
        changed.append(replace(problem, rod=softer))
        sizes.append(3000.0)
    for axis in np.eye(3)[:2]:
        turn = Rotation.from_rotvec(small * axis)
        tilted = replace(rod, gravity=tuple(turn.apply(rod.gravity)))
        changed.append(replace(problem, rod=tilted))
        sizes.append(PRIORS["gravity"] / small)
    smaller = replace(held, positions=(1 - small) * held.positions)
    changed.append(replace(problem, held=smaller))
    sizes.append(PRIORS["scale"] / small)
    steady, jitters = len(changed), []
    for unit in np.eye(6).reshape(6, 2, 3):
        changed.append(replace(problem, held=moved(held, small * unit)))
        sizes.append(PRIORS["end_position"] / small)
        jitters.append(END_NOISE / PRIORS["end_position"])
        if held.kinds[0] == CLAMPED:
            changed.append(replace(problem, held=turned(held, small * unit)))
            sizes.append(PRIORS["end_orientation"] / small)
            jitters.append(TILT_NOISE / PRIORS["end_orientation"])
    moves: Array = derivatives(problem, y, changed)[..., index, :3]
    columns: list[Array] = [size * moves[:, i] for i, size in enumerate(sizes)]
    columns[steady - 1] += PRIORS["scale"] * points
    # In every frame anew: the measured ends.
    for frame in range(len(y)):
        for column, share in zip(columns[steady : len(sizes)], jitters, strict=True):
            alone = np.zeros_like(column)
            alone[frame] = share * column[frame]
            columns.append(alone)
    errors = [CameraErrors(scale=float(np.hypot(PRIORS["scale"], PRIORS["depth_gain"])))]
    for axis in np.eye(3):
        errors.append(CameraErrors(rotation=tuple(PRIORS["camera_rotation"] * axis)))
        errors.append(CameraErrors(translation=tuple(PRIORS["camera_translation"] * axis)))
    columns += [mistaken(points, one, view) - points for one in errors]
    flat = [np.einsum("tpij,tpj->tpi", basis, column).ravel() for column in columns]
    return Meter(index, basis, np.stack(flat, axis=1), points)


def seen_change(setting: Setting, scale: Meter, world: World, states: Array) -> Array:
    """Return the change (T, P, 3) [m] at the stations, camera errors included."""
    points = states[:, scale.index, :3]
    if world.camera.flat:
        ends = setting.held.positions
        normal = np.cross(ends[:, 1] - ends[:, 0], [0.0, 0.0, 1.0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        off = np.einsum("tpi,ti->tp", points - ends[:, :1], normal)
        points = points - world.camera.flat * off[..., None] * normal[:, None]
    view = np.asarray(setting.sensor.viewpoint)
    return mistaken(points, world.camera, view) - scale.points
