"""The motion that would tell two candidates apart: their fits predict the most different shapes."""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.candidate import Candidate
from ropefit.rod.quaternion import from_rotation_vector, multiply, rotate
from ropefit.rod.setup import Motion, Setup


def motions(setup: Setup) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return ends (5, 2, 3) and clamps (5, 2, 4) of motions from the first recorded pose on."""
    first, clamp = setup.ends[0], setup.clamp[0]
    length = float(setup.properties.length.sum())
    up = setup.up
    out = {}
    fixed, still = (np.tile(pose, (5, 1, 1)) for pose in (first, clamp))
    if np.isnan(first).any():
        steps = np.linspace(-1.2, 1.2, 5)
        held = 0 if not np.isnan(first[0]).any() else 1
        axis = np.cross(up, [0.3, 1.0, 0.2])
        moved = still.copy()
        moved[:, held] = multiply(from_rotation_vector(steps[:, None] * axis), clamp[held])
        out["turn the held end up and down"] = (fixed, moved)
        return out
    chord = first[0] - first[1]
    flat = chord - (chord @ up) * up
    ahead = flat / max(np.linalg.norm(flat), 1e-9)
    side = np.cross(up, ahead)
    share = np.linspace(0, 1, 5)[:, None]

    def to(places: np.ndarray) -> np.ndarray:
        reach = places - first[1]
        far = np.maximum(np.linalg.norm(reach, axis=-1, keepdims=True), 1e-300)
        moved = fixed.copy()
        moved[:, 0] = first[1] + reach * np.minimum(0.985 * length / far, 1.0)
        return moved

    out["raise end 0"] = (to(first[0] + 0.35 * length * share * up), still)
    out["sweep end 0 sideways"] = (to(first[0] + 0.5 * length * (share - 0.5) * side), still)
    out["bring the ends together"] = (to(first[1] + chord * (1 - 0.85 * share)), still)
    taut = first[1] + ahead * (0.6 + 0.38 * share) * length
    out["pull the rope taut"] = (to(taut), still)
    angles = share * np.pi / 2
    turns = from_rotation_vector(angles * up)
    around = rotate(turns, chord)
    clamps = multiply(turns[:, None], still)
    out["turn both ends about the vertical"] = (to(first[1] + around), clamps)
    if setup.clamped[0]:
        roll = from_rotation_vector(angles * np.array([0.0, 0.0, 2.0]))
        rolled = still.copy()
        rolled[:, 0] = multiply(still[:, 0], roll)
        out["roll the gripper about the rope"] = (fixed, rolled)
    return out


def next_motion(first: Candidate, second: Candidate) -> tuple[str, float, np.ndarray | None]:
    """Return the motion that distinguishes two fits best, their rms distance [m] in it, and the
    shapes (2, 5, N+1, 3) [m] that they predict.

    A motion counts if every pose of both settles; an empty name and no shapes where none does.
    """
    best, name, predicted = 0.0, "", None
    if not first.fit.forward.instantaneous:  # the motions are series of poses
        return name, best, predicted
    for label, (ends, clamp) in motions(first.fit.forward.base).items():
        shapes = []
        for candidate in (first, second):
            base = candidate.fit.forward.base
            sensor = base.sensor._replace(
                origin=np.tile(base.sensor.origin[:1], (5, 1, 1)),
                normal=np.tile(base.sensor.normal[:1], (5, 1, 1)),
            )
            slow = base.motion and Motion(*(np.zeros((5, *m.shape[1:])) for m in base.motion))
            moved = base._replace(
                ends=ends,
                clamp=clamp,
                sensor=sensor,
                motion=slow,
                end_path=None,
                time=None,
                past=None,
            )
            forward = candidate.fit.forward
            point = forward.of_setup(moved, None, forward.terms).at(candidate.fit.point.u)
            shapes.append(point.seen)
        both = np.stack(shapes)
        if not np.isfinite(both).all():  # a rope may not follow every motion
            continue
        apart = float(np.sqrt(((both[0] - both[1]) ** 2).sum(-1).mean()))
        if apart > best:
            best, name, predicted = apart, label, both
    return name, best, predicted
