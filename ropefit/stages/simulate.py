"""simulate: a synthetic recording of a nominal rope, with a chosen path of its ends, noise,
occlusion.

For trying out a set-up and for tests of the tool itself. The rope is ropefit's own model, so a fit
to such a recording says nothing about real ropes: proofs use recordings made by other simulators.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import ValidationError

from ropefit.adapters.synthetic_sensor import write_recording
from ropefit.adapters.synthetic_spec import Point, SimulationSpec
from ropefit.artifacts.atomic import new_folder, refuse_filled
from ropefit.errors import BadInput, NotConverged
from ropefit.models.weights import WEIGHTS
from ropefit.models.xpbd import Ends, build_rope
from ropefit.perception.trace import resample
from ropefit.recordings.ends import quaternion_along
from ropefit.recordings.manifest import describe, read_toml
from ropefit.runs.protocol import Progress
from ropefit.solvers.xpbd.reference import Settings


def simulate_recording(spec: Path, out: Path, progress: Progress, say: Any) -> dict[str, Any]:
    """Write the recording that SPEC.toml describes. Raises BadInput, NotConverged, StageFailed."""
    parsed = _read_spec(spec)
    refuse_filled(out)  # before the rope is solved
    progress(0.1, "solving")
    x, ends = _states(parsed, spec)
    progress(0.8, "writing")
    with new_folder(out) as temporary:
        write_recording(parsed, x, ends, temporary)
    say(
        "made by one of the paper's solvers in ropefit: good for trying a set-up, not as evidence "
        "for it"
    )
    return {"stage": "simulate", "recording": str(out), "frames": len(x), "name": parsed.name}


def _read_spec(path: Path) -> SimulationSpec:
    try:
        return SimulationSpec.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(f"{path}: {describe(error)}")


def _states(spec: SimulationSpec, path: Path) -> tuple[np.ndarray, Ends]:
    """Return (F, K, 3) [m] centrelines and the exact end poses. `path` is named in failures."""
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
    apart = np.linalg.norm(position[:, 1] - position[:, 0], axis=1)
    if np.nanmax(np.append(apart, 0.0)) > spec.rope.length:
        worst = int(np.nanargmax(apart))
        raise BadInput(
            f"{path}: motion: in frame {worst} the ends are {apart[worst]:.4g} m apart, the rope "
            f"is {spec.rope.length:.4g} m long"
        )
    m = spec.model
    ends = Ends(position, orientation)
    rope = build_rope(
        length=spec.rope.length,
        nodes=spec.rope.nodes,
        gravity=np.array(spec.gravity),
        ends=ends,
        solver=m.solver,
        settings=Settings(m.steps, m.iterations, m.dt),
        control_node=0 if spec.motion.end0 else spec.rope.nodes - 1,
    )
    eta = torch.tensor(
        [[m.eta.get(name, WEIGHTS[name].range.start) for name in rope.names]] * frames
    )
    with torch.no_grad():
        state = rope.settle(eta.to(torch.float64))
    if not torch.isfinite(state.x).all():
        raise NotConverged("the solver diverges with these weights; lower them or use more steps")
    return state.x.numpy(), ends


def _along(waypoints: list[Point], frames: int) -> np.ndarray:
    points = np.array(waypoints, dtype=float)
    at = np.linspace(0, len(points) - 1, frames)
    return resample(points, np.arange(len(points)), at)
