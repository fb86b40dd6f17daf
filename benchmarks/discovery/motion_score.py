"""How visible what is concealed in a motion is: signal over noise, without what the nominal rope
explains.

The signal is the reference simulator's: the recording against the same film of the rope as told.
What stiffness and dampings may explain of it, to first order, is projected out by the sensitivities
of ropefit's own dynamics at the true stiffness and drag.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.discovery.motion_scenes import (
    CLIPS,
    FRAMES,
    MARKERS,
    STEP,
    Scene,
    as_told,
    filmed,
)
from reference_simulators.rod_equations import Array
from ropefit.artifacts import Model, Observations
from ropefit.fitting.motion import identified_span, long_clips, model_of
from ropefit.runs.loading import load

# Of the length, per coordinate: by which two simulations of one rope differ, as a whole clip long.
# One of MuJoCo's ropes was 0.9e-3 off with half as many edges, 0.2e-3 with half the step.
MISSED = 5e-4
EACH = 4  # frames from one that counts to the next: a rope swings slower


def score(scene: Scene, recording: Path, run: Path, elastica: Path | None = None) -> float:
    """Return signal over noise of a recording that was identified in a run."""
    with np.load(recording / "markers.npz") as told:
        there = told["positions"] - scene.jitter
    told = as_told(scene)
    without = filmed(told, linear_drag(scene, there), elastica)
    columns = nuisances(scene, run, linear_drag(scene, there))
    # What is missed alike in all of a clip is one sample.
    alike = MARKERS * len(range(0, FRAMES, EACH))
    noise = np.sqrt(scene.noise**2 + alike * (MISSED * told.world.rod.length) ** 2)
    return float(np.linalg.norm(beside(there - without, columns)) / noise)


def beside(change: Array, columns: list[Array]) -> Array:
    """Return what columns (T, P, 3) do not explain of a change (T, P, 3), of every EACH-th frame of
    a clip."""
    used = (np.arange(CLIPS * FRAMES) % FRAMES) % EACH == 0
    left, some = change[used].ravel(), np.stack([c[used].ravel() for c in columns], axis=1)
    some = some / np.maximum(np.linalg.norm(some, axis=0), 1e-300)
    return left - some @ np.linalg.lstsq(some, left, rcond=1e-9)[0]


def linear_drag(scene: Scene, markers: Array) -> float:
    """Return the drag [1/s] in proportion to speed that takes as much energy in a motion
    (CLIPS * FRAMES, MARKERS, 3) [m] as the scene's does."""
    if not callable(scene.drag):
        return scene.rate
    clips = markers.reshape(CLIPS, FRAMES, MARKERS, 3)
    speeds = np.linalg.norm(np.gradient(clips, STEP, axis=1), axis=-1).ravel()
    return float((scene.drag(speeds) * speeds**2).sum() / (speeds**2).sum())


def nuisances(scene: Scene, run: Path, drag: float) -> list[Array]:
    """Return how the markers (CLIPS * FRAMES, MARKERS, 3) move with each nominal parameter."""
    o, model = load(run, Observations)[0], load(run, Model)[0]
    span = identified_span(o, model.nominal)
    forward, u = model_of(o, model.nominal, span, long_clips(o, span))
    rod = scene.setting.rod
    true = {"EI": rod.bending, "air_damping": drag * rod.density}
    parts = [
        term.search(np.array([true[term.name]])) if term.name in true else part
        for term, part in zip(forward.terms, forward.split(u), strict=True)
    ]
    moved = forward.jacobian(forward.at(np.concatenate(parts)))
    node, at = np.linspace(0, 1, moved.shape[2]), np.linspace(0, 1, MARKERS)
    return list(CubicSpline(node, moved, axis=2)(at))
