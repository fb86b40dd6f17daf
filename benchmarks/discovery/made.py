"""A solved case, and its recording and truth as files."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery import clouds
from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.setting import END_NOISE, INTERVAL, TILT_NOISE, Setting, World
from benchmarks.discovery.setting import turned as turned_clamps
from reference_simulators.kirchhoff_rod import CLAMPED
from reference_simulators.rod_equations import Array


@dataclass(frozen=True)
class Sized:
    """A concealed effect at its size, with the score that it has on its own.

    `frames` are those whose shape it moves by 0.1 mm somewhere: a contact acts in few.
    """

    effect: Concealed
    size: float
    score: float
    frames: list[int]


@dataclass(frozen=True)
class Made:
    """A solved case: centrelines (T, n, 3) [m] and their derivatives at arc lengths (n,) [m]."""

    setting: Setting
    world: World
    sized: list[Sized]
    arc_length: Array
    nodes: Array
    tangents: Array
    simulator: str
    interval: float = INTERVAL  # s, from frame to frame


def write(
    folder: Path, truth_file: Path, name: str, made: Made, seed: int, group: str
) -> dict[str, Any]:
    """Write the recording and, elsewhere, its truth."""
    setting, world = made.setting, made.world
    rng = np.random.default_rng([seed, 1])
    radius, sensor = 0.5 * setting.diameter, setting.sensor
    frames = []
    for nodes, tangents, ends in zip(made.nodes, made.tangents, world.held.positions, strict=True):
        points = clouds.surface(nodes, tangents, made.arc_length, radius, sensor, rng)
        frames.append(clouds.observe(points, ends, world.camera, sensor, rng))
    held, orientations = setting.held, None
    positions = held.positions + END_NOISE * rng.standard_normal(held.positions.shape)
    if world.camera.ends_too:
        view = np.asarray(sensor.viewpoint)
        positions = view + (1 + world.camera.scale) * (positions - view)
    if held.kinds[0] == CLAMPED:
        parts = [
            turned_clamps(
                replace(held, orientations=held.orientations[t : t + 1]),
                TILT_NOISE * rng.standard_normal((2, 3)),
            ).orientations
            for t in range(len(positions))
        ]
        orientations = np.concatenate(parts)
    rod = setting.rod
    mass = rod.density * rod.length
    metadata = clouds.Metadata(
        name, rod.gravity, rod.length, setting.diameter, mass, positions, orientations,
        made.interval,
    )  # fmt: skip
    clouds.write(folder, metadata, frames, sensor)
    truth = {
        "name": name,
        "group": group,
        "effects": [
            {
                "name": one.effect.name,
                "kind": one.effect.kind,
                "arc_length_m": one.effect.place,
                "parameter": one.effect.parameter,
                "unit": one.effect.unit,
                "value": one.effect.reported(one.size),
                "score": one.score,
                "frames": one.frames,
            }
            for one in made.sized
        ],
        "simulator": made.simulator,
        "calibration_errors": bool(any(world.camera.rotation)),
        "clamped": held.kinds[0] == CLAMPED,
        "length_m": rod.length,
        "bending_N_m2": rod.bending,
        "stiffness": rod.bending / (rod.density * 9.81 * rod.length**3),
        "noise_m": sensor.noise,
        "frames": len(frames),
    }
    truth_file.parent.mkdir(parents=True, exist_ok=True)
    truth_file.write_text(json.dumps(truth, indent=1) + "\n")
    return truth
