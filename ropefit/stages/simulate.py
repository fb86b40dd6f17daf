"""simulate: a synthetic recording of a nominal rope, or of one that was fitted, with a chosen path
of its ends, noise, occlusion.

For trying out a set-up and for tests of the tool itself. The rope is ropefit's own model, so a fit
to such a recording says nothing about real ropes: proofs use recordings made by other simulators.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from ropefit.adapters.synthetic_sensor import write_recording
from ropefit.adapters.synthetic_spec import Point, RopeSpec, SimulationSpec
from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.atomic import new_folder, refuse_filled
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.fitting.simulated import moving_rope, physical, settled_rope
from ropefit.models.algorithm import Algorithm
from ropefit.models.weights import ETA, RANGES
from ropefit.models.xpbd import Xpbd
from ropefit.perception.trace import resample
from ropefit.recordings.ends import quaternion_along
from ropefit.recordings.manifest import describe, read_toml
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare
from ropefit.runs.loading import load, load_if_there
from ropefit.runs.protocol import Progress
from ropefit.runs.run_directory import existing_run
from ropefit.solvers.xpbd.settings import Settings

MADE_BY_PAPER = "one of the paper's solvers"


def simulate_recording(spec: Path, out: Path, progress: Progress, say: Any) -> dict[str, Any]:
    """Write the recording that SPEC.toml describes. Raises BadInput, NotConverged, StageFailed."""
    parsed = _read_spec(spec)
    refuse_filled(out)  # before the rope is solved
    progress(0.1, "solving")
    ends = _ends(parsed, spec)
    if parsed.model.run:
        parsed, x, setup, told = _fitted(parsed, spec.parent / parsed.model.run, *ends)
    else:
        (x, setup), told = _nominal(parsed, spec, *ends), MADE_BY_PAPER
    progress(0.8, "writing")
    with new_folder(out) as temporary:
        write_recording(parsed, x, setup, temporary)
    say(f"made by {told} in ropefit: good for trying a set-up, not as evidence for it")
    return {"stage": "simulate", "recording": str(out), "frames": len(x), "name": parsed.name}


def _read_spec(path: Path) -> SimulationSpec:
    try:
        return SimulationSpec.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(f"{path}: {describe(error)}")


def _ends(spec: SimulationSpec, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends (F, 2, 3) [m] and their orientations (F, 2, 4), NaN where free or not held.
    `path` is named in failures."""
    frames = spec.motion.frames
    position = np.full((frames, 2, 3), np.nan)
    orientation = np.full((frames, 2, 4), np.nan)
    for number, end in enumerate((spec.motion.end0, spec.motion.end1)):
        if end is None:
            continue
        position[:, number] = _along(end.path, frames)
        if end.tangents:
            tangents = _along(end.tangents, frames)
            if (np.linalg.norm(tangents, axis=1) < 1e-9).any():
                raise BadInput(
                    f"{path}: motion.end{number}.tangents: a tangent is zero between two waypoints"
                )
            orientation[:, number] = [quaternion_along(tangent) for tangent in tangents]
    return position, orientation


def _check_reach(length: float, position: np.ndarray, path: Path) -> None:
    """Raise BadInput where ends (F, 2, 3) [m] are farther apart than the rope is long [m]."""
    apart = np.linalg.norm(position[:, 1] - position[:, 0], axis=1)
    if np.nanmax(np.append(apart, 0.0)) > length:
        worst = int(np.nanargmax(apart))
        raise BadInput(
            f"{path}: motion: in frame {worst} the ends are {apart[worst]:.4g} m apart, the rope "
            f"is {length:.4g} m long"
        )


def _nominal(
    spec: SimulationSpec, path: Path, position: np.ndarray, orientation: np.ndarray
) -> tuple[np.ndarray, Setup]:
    """Return (F, K, 3) [m] centrelines of a rope by the paper's model, with its exact end poses."""
    rope = spec.matter
    _check_reach(rope.length, position, path)
    m = spec.model
    weights = [m.eta.get(name, RANGES[name].start) for name in ETA]
    setup = bare(
        uniform(length=rope.length, segments=rope.nodes - 1, bend=1.0),
        np.array(spec.gravity),
        position,
        orientation,
        np.zeros(3),
    )._replace(weights=np.array(weights))
    held = 0 if spec.motion.end0 else rope.nodes - 1
    algorithm = Algorithm(m.solver, Settings(m.steps, m.iterations, m.dt), held)
    point = Xpbd(setup, [], algorithm=algorithm).at(np.empty(0))
    if not point.converged.all():
        raise NotConverged("the solver diverges with these weights; lower them or use more steps")
    return point.solution.x, setup


def _fitted(
    spec: SimulationSpec, run: Path, position: np.ndarray, orientation: np.ndarray
) -> tuple[SimulationSpec, np.ndarray, Setup, str]:
    """Return the spec with a run's rope in it, centrelines (F, K, 3) [m], the setup, and what made
    them."""
    existing_run(run)
    o, model = load(run, Observations)[0], load(run, Model)[0].nominal
    found = load_if_there(run, Diagnosis)
    if model.balance is None and model.stepped is None:
        raise WrongUsage(
            f"{run}: the model was fitted by {model.solver}, whose weights no new pose is told "
            "by; run ropefit identify --solver equilibrium, or dynamics, first"
        )
    if model.balance is not None:
        x, setup = settled_rope(o, model, found, position, orientation)
    else:
        still = [0, *range(spec.motion.frames - 1)]  # it begins at rest
        time = spec.motion.interval * np.arange(spec.motion.frames)
        x, setup = moving_rope(o, model, found, position[still], orientation[still], time)
    given: dict[str, Any] = {"length": o.length, "mass": o.mass, "nodes": x.shape[1]}
    if o.diameter:
        given["diameter"] = o.diameter
    gravity = tuple(o.gravity.tolist())
    spec = spec.model_copy(update={"rope": RopeSpec(**given), "gravity": gravity})
    with_them = ", ".join(cause.name for cause in physical(model, found)) or "nothing besides"
    return spec, x, setup, f"the rope of {run} ({with_them})"


def _along(waypoints: list[Point], frames: int) -> np.ndarray:
    points = np.array(waypoints, dtype=float)
    at = np.linspace(0, len(points) - 1, frames)
    return resample(points, np.arange(len(points)), at)
