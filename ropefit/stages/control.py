"""control: where the control point was in every frame, or where it must go to reach a target
shape."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ropefit.adapters.control_rope import control_guess, rope_at, settles
from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.scene import build_scene, check_loss, control_positions, pinhole
from ropefit.adapters.targets import Targets
from ropefit.artifacts import Diagnosis, FittedModel, Model, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference import bfgs
from ropefit.inference.bfgs import Search
from ropefit.inference.control import Gripper, interpolate, to_observations, to_targets
from ropefit.losses.objectives import OBJECTIVES, Pinhole, objective
from ropefit.runs.protocol import Context

STARTS = 6  # recorded poses from which shape control tries to set out


def compute(inputs: dict[str, Any], settings: ControlSettings, context: Context) -> dict[str, Any]:
    """Return the contents of control.h5. Raises BadInput, NotConverged."""
    observations: Observations = inputs[Observations.file_name]
    model: FittedModel = inputs[Model.file_name].nominal
    if (found := context.external.get("diagnosis")) and found.causes:
        names = ", ".join(cause.name for cause in found.causes.values())
        used = settles(observations, model, found)
        context.say(f"with {names}" if used else f"without {names}: the control point lies inside")
    if settings.target:
        return _shape(observations, model, settings, context, context.external["targets"])
    return _estimate(observations, model, settings, context)


def _estimate(o: Observations, model: FittedModel, settings: ControlSettings, context: Context):
    check_loss(o, settings.loss)
    node = model.control_node
    turns = bool(settings.turn)
    _check_turn(turns, node)
    guess = control_guess(o, node)
    found = context.external.get("diagnosis")
    rope, values = rope_at(o, model, guess, turns, found, moving=True)
    scene = build_scene(o).tensors()
    chosen = objective(settings.loss)
    gripper = Gripper(rope, values, to_observations(chosen, scene), 0.1 * o.length, turns)
    search = _run(gripper, settings, context)
    x, q = _settle(gripper, search.u)
    noise = float(np.median(o.noise))
    sd = gripper.position_sd(search.u, len(o.node_arc) - 1, noise)
    with torch.no_grad():
        obj1 = OBJECTIVES["OBJ1"].loss(torch.from_numpy(x), scene).numpy()
    arc = np.tile(np.array(settings.key, dtype=float), (len(o.frames), 1))
    if arc.size and (arc.min() < 0 or arc.max() > o.length):
        raise WrongUsage(f"--key {arc.min():g}..{arc.max():g} m: the rope runs to {o.length:g} m")
    position = gripper.position(search.u)
    observed = _observed_at(o, arc)
    return {
        "kind": "estimate",
        "loss_name": settings.loss,
        "cases": o.frames,
        "start": guess,
        "position": position,
        "position_sd": sd,
        "reference": control_positions(o, node),
        "obj1": obj1,
        **_common(o, model, found, gripper, search, x, q, turns),
        **_deviations(o, position, control_positions(o, node), x, arc, observed),
    }


def _shape(
    o: Observations,
    model: FittedModel,
    settings: ControlSettings,
    context: Context,
    targets: Targets,
):
    node = model.control_node
    turns = settings.turn if settings.turn is not None else node == 0
    _check_turn(turns, node)
    recorded = control_positions(o, node)
    frames = np.flatnonzero(np.isfinite(recorded).all(axis=1))
    if frames.size == 0:
        raise BadInput("no frame has a recorded control point to set out from")
    starts = frames[np.unique(np.linspace(0, frames.size - 1, STARTS).astype(int))]
    cases = len(targets.points)
    # Every target from every start; the rope's other ends stay where that frame had them.
    frame = np.tile(starts, cases)
    case = np.repeat(np.arange(cases), len(starts))
    found = context.external.get("diagnosis")
    rope, values = rope_at(o, model, recorded, turns, found, moving=False)
    whole = rope.frames(frame)
    compare = to_targets(targets.arc[case], targets.points[case], o.length)
    gripper = Gripper(whole, values[frame], compare, 0.1 * o.length, turns)
    with torch.no_grad():
        rows = torch.arange(len(frame))
        zero = torch.zeros(len(frame), gripper.unknowns, dtype=torch.float64)
        first = gripper.loss(zero, rows).reshape(cases, -1).nan_to_num(torch.inf).numpy()
    best = first.argmin(1) + np.arange(cases) * len(starts)
    gripper = Gripper(
        whole.frames(best),
        gripper.eta[best],
        to_targets(targets.arc, targets.points, o.length),
        0.1 * o.length,
        turns,
    )
    search = _run(gripper, settings, context)
    x, q = _settle(gripper, search.u)
    sd = gripper.position_sd(search.u, targets.points.shape[1], float(np.median(o.noise)))
    nowhere = np.full((cases, 3), np.nan)
    reached = _reached(x, targets, o.length)
    content = {
        "kind": "shape",
        "loss_name": "targets",
        "cases": targets.number,
        "start": whole.frames(best).start.x[:, node].numpy().copy(),
        "position": gripper.position(search.u),
        "position_sd": sd,
        "reference": nowhere,
        "obj1": np.full(cases, np.nan),
        **_common(o, model, found, gripper, search, x, q, turns),
        **_deviations(o, nowhere, nowhere, x, targets.arc, targets.points),
    }
    content["key_position"] = reached
    content.update(_key_deviations(pinhole(o), reached, targets.points))
    content["notes"].append(
        "the rope's other end is held where the starting frame had it; "
        f"each target set out from the best of {len(starts)} recorded poses"
    )
    return content


def _check_turn(turns: bool, node: int) -> None:
    if turns and node != 0:
        raise WrongUsage("the orientation can be moved only at end 0; leave out --turn")


def _run(gripper: Gripper, settings: ControlSettings, context: Context) -> Search:
    def report(search: Search) -> None:
        running = int((search.status == bfgs.ACTIVE).sum())
        share = search.evaluations / settings.evaluations
        context.progress(share, f"{running} of {len(search.u)} still moving")

    search = gripper.search(settings.evaluations, report)
    if (search.status == bfgs.DIVERGED).all():
        raise NotConverged("the solver fails from every start; identify again")
    missed = int((~search.converged).sum())
    if missed:
        context.say(f"warning: {missed} of {len(search.u)} searches did not converge (marked)")
    return search


def _settle(gripper: Gripper, u: torch.Tensor) -> tuple[np.ndarray, np.ndarray]:
    with torch.no_grad():
        state = gripper.state(u, torch.arange(len(u)))
    if not torch.isfinite(state.x).all():
        raise NotConverged(f"the solver fails in some frames; {gripper.rope.advice}")
    return state.x.numpy(), state.q.numpy()


def _common(
    o: Observations, model: FittedModel, found: Diagnosis | None, gripper: Gripper, search: Search,
    x: np.ndarray, q: np.ndarray, turns: bool,
) -> dict[str, Any]:  # fmt: skip
    length = _length(gripper, search.u, x)
    empty = np.full((len(x), 4), np.nan)
    settled = settles(o, model, found)
    notes = []
    if not (settled or model.solver_converged):
        notes.append("the solver has not converged: positions depend on its number of iterations")
    return {
        "solver": "equilibrium" if settled else model.solver,
        "control_node": model.control_node,
        "moves_orientation": turns,
        "orientation": gripper.orientation(search.u) if turns else empty,
        "loss": search.loss.numpy(),
        "converged": search.converged.numpy(),
        "x": x,
        "q": q,
        "length_error": length / o.length - 1,
        "length": o.length,
        "notes": notes,
    }


def _length(gripper: Gripper, u: torch.Tensor, x: np.ndarray) -> np.ndarray:
    """Return (F,) [m] lengths of ropes x (F, K, 3), by every node of the rod where x has only
    some."""
    if gripper.rope.finest is not gripper.rope:
        x = _settle(replace(gripper, rope=gripper.rope.finest), u)[0]
    return np.linalg.norm(np.diff(x, axis=1), axis=2).sum(axis=1)


def _deviations(
    o: Observations, position, reference, x: np.ndarray, arc: np.ndarray, observed: np.ndarray
) -> dict[str, np.ndarray]:
    """Return deviations of the control point and of the key points, in metres and pixels."""
    camera = pinhole(o)
    share = torch.from_numpy(np.nan_to_num(arc) / o.length)
    key = interpolate(torch.from_numpy(x), share).numpy()
    key[~np.isfinite(arc)] = np.nan
    return {
        "deviation": np.linalg.norm(position - reference, axis=-1),
        "deviation_px": _pixels(camera, position, reference),
        "key_arc": arc,
        "key_position": key,
        "key_reference": observed,
        **_key_deviations(camera, key, observed),
    }


def _key_deviations(
    camera: Pinhole, key: np.ndarray, observed: np.ndarray
) -> dict[str, np.ndarray]:
    return {
        "key_deviation": np.linalg.norm(key - observed, axis=-1),
        "key_deviation_px": _pixels(camera, key, observed),
    }


def _pixels(camera: Pinhole, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(camera.project(a) - camera.project(b), axis=-1)


def _observed_at(o: Observations, arc: np.ndarray) -> np.ndarray:
    """Return (F, M, 3) [m] the observed centreline at arc lengths (F, M); NaN where it was not
    seen."""
    out = np.full((*arc.shape, 3), np.nan)
    for t in range(len(arc)):
        for axis in range(3):
            # np.interp with NaN neighbours gives NaN: unseen stays unseen.
            out[t, :, axis] = np.interp(arc[t], o.node_arc, o.centreline[t, :, axis])
    return out


def _reached(x: np.ndarray, targets: Targets, length: float) -> np.ndarray:
    """Return (C, M, 3) [m] the point of the rope that answers to each target point."""
    compare = to_targets(targets.arc, targets.points, length)
    with torch.no_grad():
        known, loose = compare(torch.from_numpy(x), torch.arange(len(x)))
    gap = torch.where(known.mask[..., None], known.vectors, loose.vectors).numpy()
    return targets.points - np.where(np.isfinite(targets.points), gap, np.nan)
