"""identify by the paper's solvers: the weights of Algorithm 1, by a loss of the paper."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ropefit.adapters.frames import group_frames, held_out, spread_evenly
from ropefit.adapters.scene import build_scene, control_positions, node_at
from ropefit.adapters.units import Stated
from ropefit.adapters.xpbd_model import xpbd_of
from ropefit.artifacts import FittedModel, Iterated, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.fitting.search import describe, run_search
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference import bfgs
from ropefit.inference.evaluate import agreement
from ropefit.inference.identify import Task
from ropefit.inference.search_space import Space
from ropefit.losses.objectives import objective
from ropefit.models.algorithm import Algorithm
from ropefit.models.weights import RANGES, WEIGHTS
from ropefit.models.xpbd import Xpbd
from ropefit.runs.protocol import Context
from ropefit.solvers.xpbd.settings import Settings

STATED = {name: Stated(1.0, "1", weight.meaning) for name, weight in WEIGHTS.items()}
DRIFT_ALLOWED = 1e-3  # of the length: a solver that still moves more than this has not converged


def compute(
    observations: Observations, settings: IdentifySettings, context: Context
) -> FittedModel:
    """Return the nominal model. Raises BadInput, NotConverged, WrongUsage."""
    first = _started(observations, settings)
    full = _task(observations, settings, first)
    group = full.group.numpy()
    out = held_out(len(group), settings.holdout)
    train = spread_evenly(np.flatnonzero(~out), group, settings.most_frames)
    task = full.frames(torch.from_numpy(train))
    search = run_search(task, settings, context)
    if (search.status == bfgs.DIVERGED).any():
        raise NotConverged(
            f"the {settings.solver} solver diverges from the starting weights; lower them with "
            "--start or use fewer --steps"
        )
    values = task.space.to_values(search.u).detach().numpy()
    context.progress(0.95, "simulating all frames")
    states = _states(observations, settings, first, values[group])
    context.progress(0.97, "uncertainty")
    groups = describe(task, values, search, observations, group, STATED)
    rms = states["rms"]
    return FittedModel(
        **states,
        groups=groups,
        heldout=out,
        trace=torch.stack(search.trace).sum(dim=1).numpy(),
        rms_fit=float(np.sqrt(np.mean(rms[train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(rms[out] ** 2))) if out.any() else None,
    )


def _started(o: Observations, settings: IdentifySettings) -> Xpbd:
    """Return the model of all frames with the weights that a search starts from. Raises BadInput,
    WrongUsage."""
    options = Settings(settings.steps, settings.iterations, settings.dt, *settings.compliance)
    node = node_at(o, settings.control_at)
    algorithm = Algorithm(settings.solver, options, node, settings.two_sided)
    _check_names(settings, algorithm.names)
    usable = np.isfinite(control_positions(o, node)).all(axis=1)
    if settings.two_sided and not 0 < node < len(o.node_arc) - 1:
        raise WrongUsage(
            "two gravity weights need a control point inside the rope: give --control-at"
        )
    usable |= o.end_kind[0] == "free" and node == 0
    if not usable.all():
        raise BadInput(
            f"frame {o.frames[np.argmin(usable)]}: the control point at "
            f"{settings.control_at} m is not seen; choose a visible place or drop the frame"
        )
    start = [settings.start.get(name, RANGES[name].start) for name in algorithm.names]
    return xpbd_of(o, algorithm, np.array(start))


def _task(o: Observations, settings: IdentifySettings, first: Xpbd) -> Task:
    """Return the search over all frames."""
    names = first.algorithm.names
    space = Space.of(names, settings.free or list(names), settings.start, RANGES)
    group = torch.from_numpy(group_frames(o, settings.groups))
    rope = first.rope_at(first.base)
    return Task(rope, build_scene(o).tensors(), objective(settings.loss), space, group)


def _states(
    o: Observations, settings: IdentifySettings, first: Xpbd, weights: np.ndarray
) -> dict[str, Any]:
    """Return the part of the model on the states of all frames, with weights (F, n). Raises
    NotConverged."""
    none = np.empty(0)
    fitted = first.of_setup(first.base._replace(weights=weights))
    point = fitted.at(none)
    if not point.converged.all():
        raise NotConverged(
            f"the {settings.solver} solver diverges in some frames; use more --steps"
        )
    x, rope, scene = point.solution.x, fitted.rope_at(fitted.base), build_scene(o)
    before = first.at(none).solution.x
    progress = rope.convergence(weights, x)
    now, then = agreement(x, scene), agreement(before, scene)
    return {
        "solver": settings.solver,
        "loss": settings.loss,
        "search": settings.how,
        "control_node": rope.control_node,
        "fixed_nodes": list(rope.held_nodes),
        "two_sided": settings.two_sided,
        "x": x,
        "q": point.solution.q,
        "x_initial": before,
        "residual": now.residual,
        "rms": now.rms,
        "rms_initial": then.rms,
        "rms_px": now.rms_px,
        "solver_converged": float(np.median(progress.drift)) < DRIFT_ALLOWED,
        "iterated": Iterated(
            steps=settings.steps,
            iterations=settings.iterations,
            dt=settings.dt,
            compliance=settings.compliance,
            iteration=progress.iteration,
            distance_violation=progress.distance_violation,
            length_error=progress.length_error,
            drift=progress.drift,
            drift_allowed=DRIFT_ALLOWED,
        ),
    }


def _check_names(settings: IdentifySettings, names: tuple[str, ...]) -> None:
    for name in [*(settings.free or []), *settings.start]:
        if name not in names:
            raise WrongUsage(f"unknown parameter {name}; one of {', '.join(names)}")
    for name, value in settings.start.items():
        _, low, high = RANGES[name]
        if not low <= value <= high:
            raise WrongUsage(f"start {name} = {value:g} is outside its bounds {low:g}..{high:g}")
