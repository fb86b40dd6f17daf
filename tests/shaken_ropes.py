"""Recordings of a clamped rope that is shaken, by a rod four times as fine as fits are."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ropefit.recordings.ends import quaternion_along
from ropefit.recordings.writer import About, RecordingWriter
from ropefit.rod.moving import Moving, moving
from ropefit.rod.quaternion import from_rotation_vector, multiply
from ropefit.rod.rod import build, uniform
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.equilibrium.conditions import Conditions
from ropefit.solvers.equilibrium.solve import solve as settle
from tests.moving_ropes import DOWN, damping, stepped
from tests.ropecloud import cloud

EI, GJ, LOSS, AIR, MASS, LENGTH = 2e-3, 1.5e-3, 1e-4, 0.03, 0.06, 0.8
FRAMES, MARKERS, STEPS = 160, 9, 4
FINE, WEIGHT_AT = 160, 0.3  # segments; m
FILMED = 3  # every so many frames a camera takes one: 33 in a second
RADIUS, EYE = 0.004, np.array([0.25, -1.3, 0.1])  # m
OTHER_END = (0.5, 0.05, 0.1)  # m, of end 1


class Clip(NamedTuple):
    """time (F,) [s]; nodes (F, FINE+1, 3) [m]; ends (F, 2, 7): positions [m] and orientations."""

    time: np.ndarray
    x: np.ndarray
    ends: np.ndarray


def fine_rope(weight: float = 0.0, bend: float = EI) -> Moving:
    """Return the rope that is recorded, with a weight [kg] at WEIGHT_AT; bend [N m²]."""
    p = uniform(length=LENGTH, segments=FINE, bend=bend, twist=GJ, density=MASS / LENGTH)
    rod, mass = build(p, DOWN, (True, True)), np.zeros(FINE + 1)
    mass[round(WEIGHT_AT / LENGTH * FINE)] = weight
    rod = rod._replace(load=rod.load + mass[:, None] * DOWN)
    return moving(p, rod, damping(p, bend=LOSS, twist=LOSS, air=AIR), mass)


def level_clamps() -> np.ndarray:
    """Return (2, 4) how the ends are held while nothing moves."""
    tangents = ((1.0, 0, -1), (1.0, 0, 1))
    return np.stack([quaternion_along(np.array(v)) for v in tangents])


def shaken_clips(weight: float = 0.0, bend: float = EI) -> list[Clip]:
    """Return two clips of FRAMES frames, 10 ms apart."""
    moved = fine_rope(weight, bend)
    count = (FRAMES - 1) * STEPS + 1
    time, clips = np.arange(count) * 0.01 / STEPS, []
    for clip in range(2):
        t = time + 3 * clip
        grow = (np.minimum(time / 0.3, 1) ** 2)[:, None]
        sway = np.stack([0.1 * np.sin(6 * t), 0.12 * np.sin(9 * t), 0.05 * t], -1)
        ends = np.tile([[0.0, 0, 0], OTHER_END], (count, 1, 1))
        ends[:, 0] += grow * (sway - sway[:1])
        nod = np.zeros((count, 2, 3))
        nod[:, 0, 0] = 0.3 * grow[:, 0] * np.sin(5 * t)
        clamp = multiply(level_clamps(), from_rotation_vector(nod))
        first = settle(moved.rod, Conditions(ends[:1], clamp[:1]))
        assert first.converged.all()
        start = Start(first.x, first.q, np.zeros((1, FINE + 1, 3)))
        found = stepped(moved, Drive(time[None], ends[None], clamp[None]), start)
        held = np.concatenate([ends, clamp], axis=-1)[::STEPS]
        clips.append(Clip(time[::STEPS] + 10 * clip, found.x[0][::STEPS], held))
    return clips


def shaken(folder: Path, weight: float = 0.0, bend: float = EI) -> Path:
    """Write both clips as markers, the ends' poses beside them."""
    return _write_markers(folder, shaken_clips(weight, bend), 2e-5)


def posed(folder: Path, weight: float = 0.0, poses: int = 12) -> Path:
    """Write markers of the rope at rest, in poses of end 0 all around."""
    t = np.linspace(0, 2 * np.pi, poses)
    ends = np.tile(np.array([[0.0, 0, 0], OTHER_END]), (poses, 1, 1))
    ends[:, 0] += np.stack([0.15 * np.sin(t), 0.15 * np.cos(2 * t), 0.1 * np.cos(t)], axis=1)
    clamp = np.tile(level_clamps(), (poses, 1, 1))
    found = settle(fine_rope(weight).rod, Conditions(ends, clamp))
    assert found.converged.all()
    held = np.concatenate([ends, clamp], axis=-1)
    return _write_markers(folder, [Clip(np.arange(float(poses)), found.x, held)], 2e-4)


def filmed(folder: Path, weight: float = 0.0, points: int = 200, noise: float = 1e-3) -> Path:
    """Write both clips as clouds of the side that faces EYE, fewer frames in a second; points and
    their noise [m] of a frame."""
    folder.mkdir(exist_ok=True)
    clips = [Clip(*(part[::FILMED] for part in clip)) for clip in shaken_clips(weight)]
    rng, arc = np.random.default_rng(5), np.linspace(0, LENGTH, FINE + 1)
    about = About("filmed", length=LENGTH, diameter=2 * RADIUS, mass=MASS)
    writer = RecordingWriter(folder, about)
    (folder / "clouds").mkdir()
    for frame, curve in enumerate(np.concatenate([clip.x for clip in clips])):
        dense = np.linspace(0, LENGTH, 2001)
        curve = np.stack([np.interp(dense, arc, axis) for axis in curve.T], axis=1)
        writer.write_cloud(frame, cloud(dense, curve, points, rng, RADIUS, noise, EYE)[0])
    _write_ends(folder, clips)
    (folder / "recording.toml").write_text(
        'format = "ropefit-recording/1"\nname = "filmed"\ngravity = [0, 0, -9.81]\n'
        f"[rope]\nlength = {LENGTH}\nmass = {MASS}\ndiameter = {2 * RADIUS}\n"
        '[ends]\nfile = "ends.csv"\n[clouds]\npattern = "clouds/{frame:06d}.ply"\n'
        f"viewpoint = {EYE.tolist()}\n"
    )
    return folder


def _write_markers(folder: Path, clips: list[Clip], noise: float) -> Path:
    folder.mkdir(exist_ok=True)
    every = FINE // (MARKERS - 1)
    markers = np.concatenate([clip.x[:, ::every] for clip in clips])
    markers += noise * np.random.default_rng(0).normal(size=markers.shape)
    np.savez(
        folder / "markers.npz", positions=markers, time=np.concatenate([c.time for c in clips]),
        arc_length=np.linspace(0, LENGTH, MARKERS),
    )  # fmt: skip
    _write_ends(folder, clips)
    (folder / "recording.toml").write_text(
        'format = "ropefit-recording/1"\nname = "shaken"\ngravity = [0, 0, -9.81]\n'
        f"[rope]\nlength = {LENGTH}\nmass = {MASS}\n"
        '[ends]\nfile = "ends.csv"\n[markers]\nfile = "markers.npz"\n'
    )
    return folder


def _write_ends(folder: Path, clips: list[Clip]) -> None:
    rows, frame = ["frame,time,end,x,y,z,qw,qx,qy,qz"], 0
    for clip in clips:
        for time, both in zip(clip.time, clip.ends, strict=True):
            for end, pose in enumerate(both):
                told = ",".join(map(repr, pose.tolist()))
                rows.append(f"{frame},{float(time)!r},{end},{told}")
            frame += 1
    (folder / "ends.csv").write_text("\n".join(rows) + "\n")
