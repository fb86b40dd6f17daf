"""The motion that would tell two candidates apart: their fits predict the most different shapes."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.diagnosis.candidate import Candidate
from ropefit.rod.quaternion import from_rotation_vector, multiply, rotate
from ropefit.rod.setup import Motion, Setup


def motions(setup: Setup) -> dict[str, tuple[torch.Tensor, torch.Tensor]]:
    """Return ends (5, 2, 3) and clamps (5, 2, 4) of motions from the first recorded pose on."""
    first, clamp = setup.ends[0].clone(), setup.clamp[0].clone()
    length = float(setup.properties.length.sum())
    up = setup.up
    out = {}
    still = clamp[None].expand(5, 2, 4)
    if bool(torch.isnan(first).any()):
        steps = torch.linspace(-1.2, 1.2, 5, dtype=torch.float64)
        held = 0 if not bool(torch.isnan(first[0]).any()) else 1
        axis = torch.linalg.cross(up, torch.tensor([0.3, 1.0, 0.2], dtype=torch.float64))
        turned = torch.stack([multiply(from_rotation_vector(a * axis), clamp[held]) for a in steps])
        moved = still.clone()
        moved[:, held] = turned
        out["turn the held end up and down"] = (first[None].expand(5, 2, 3), moved)
        return out
    chord = first[0] - first[1]
    flat = chord - (chord @ up) * up
    ahead = flat / flat.norm().clamp_min(1e-9)
    side = torch.linalg.cross(up, ahead)
    share = torch.linspace(0, 1, 5, dtype=torch.float64)[:, None]

    def to(places: torch.Tensor) -> torch.Tensor:
        reach = places - first[1]
        far = reach.norm(dim=-1, keepdim=True)
        places = first[1] + reach * torch.clamp(0.985 * length / far, max=1.0)
        return torch.stack([places, first[1].expand(5, 3)], dim=1)

    out["raise end 0"] = (to(first[0] + 0.35 * length * share * up), still)
    out["sweep end 0 sideways"] = (to(first[0] + 0.5 * length * (share - 0.5) * side), still)
    out["bring the ends together"] = (to(first[1] + chord * (1 - 0.85 * share)), still)
    taut = first[1] + ahead * (0.6 + 0.38 * share) * length
    out["pull the rope taut"] = (to(taut), still)
    angles = share[:, 0] * torch.pi / 2
    turns = torch.stack([from_rotation_vector(a * up) for a in angles])
    around = rotate(turns, chord)
    clamps = multiply(turns[:, None], still)
    out["turn both ends about the vertical"] = (to(first[1] + around), clamps)
    if setup.clamped[0]:
        about = torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64)
        roll = torch.stack([from_rotation_vector(a * about) for a in angles])
        rolled = still.clone()
        rolled[:, 0] = multiply(still[:, 0], roll)
        out["roll the gripper about the rope"] = (first[None].expand(5, 2, 3), rolled)
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
                origin=base.sensor.origin[:1].expand(5, 1, 3),
                normal=base.sensor.normal[:1].expand(5, 1, 3),
            )
            slow = base.motion and Motion(
                *(torch.zeros_like(item[:1]).expand(5, *item.shape[1:]) for item in base.motion)
            )
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
