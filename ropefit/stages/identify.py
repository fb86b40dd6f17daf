"""identify: parameters that make simulation and observations agree; here, the paper's weights."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from ropefit.artifacts import FittedModel, Iterated, Model, Observations
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference import minimise
from ropefit.inference.evaluate import agreement, convergence, settle_frames
from ropefit.inference.identify import Task
from ropefit.inference.parameters import Space
from ropefit.inference.rope import MEANING, bounds, eta_names
from ropefit.losses.objectives import OBJECTIVES
from ropefit.solvers.xpbd.reference import Settings
from ropefit.stages import identify_equilibrium, identify_motion, identify_searched
from ropefit.stages.frames import group_frames, held_out, spread_evenly
from ropefit.stages.identify_settings import IdentifySettings
from ropefit.stages.scene import build_scene, check_loss, control_positions, node_at, rope_of
from ropefit.stages.search import describe, run_search
from ropefit.stages.stage import Context, Stage

DRIFT_ALLOWED = 1e-3  # of the length: a solver that still moves more than this has not converged


def compute(inputs: dict[str, Any], settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """The contents of model.h5. Raises BadInput, NotConverged."""
    observations: Observations = inputs[Observations.file_name]
    check_loss(observations, settings.loss)
    if settings.solver == "dynamics":
        return identify_motion.compute(observations, settings, context)
    if settings.how == "least-squares":
        return identify_equilibrium.compute(observations, settings, context)
    if settings.solver == "equilibrium":
        return identify_searched.compute(observations, settings, context)
    names = eta_names(settings.two_sided)
    _check_names(settings, names)
    space = Space.of(names, settings.free or list(names), settings.start)
    node = node_at(observations, settings.control_at)
    usable = np.isfinite(control_positions(observations, node)).all(axis=1)
    if settings.two_sided and not 0 < node < len(observations.node_arc) - 1:
        raise WrongUsage(
            "two gravity weights need a control point inside the rope: give --control-at"
        )
    usable |= observations.end_kind[0] == "free" and node == 0
    if not usable.all():
        raise BadInput(
            f"frame {observations.frames[np.argmin(usable)]}: the control point at "
            f"{settings.control_at} m is not seen; choose a visible place or drop the frame"
        )
    rope = rope_of(
        observations,
        solver=settings.solver,
        settings=Settings(settings.steps, settings.iterations, settings.dt, *settings.compliance),
        control_node=node,
        two_sided=settings.two_sided,
    )
    scene = build_scene(observations)
    group = group_frames(observations, settings.groups)
    out = held_out(len(group), settings.holdout)
    train = spread_evenly(np.flatnonzero(~out), group, settings.most_frames)
    full = Task(rope, scene, OBJECTIVES[settings.loss], space, torch.from_numpy(group))
    task = full.frames(torch.from_numpy(train))

    search = run_search(task, settings, context)
    if (search.status == minimise.DIVERGED).any():
        raise NotConverged(
            f"the {settings.solver} solver diverges from the starting weights; lower them with "
            "--start or use fewer --steps"
        )
    values = space.to_values(search.u).detach().numpy()
    eta = torch.from_numpy(values)[full.group]
    context.progress(0.95, "simulating all frames")
    state = settle_frames(rope, eta)
    if not torch.isfinite(state.x).all():
        raise NotConverged(
            f"the {settings.solver} solver diverges in some frames; use more --steps"
        )
    first = torch.from_numpy(np.tile(space.start, (len(group), 1)))
    before = settle_frames(rope, first)
    progress = convergence(rope, eta, state.x)
    now, then = agreement(state.x, scene), agreement(before.x, scene)

    groups = {}
    for number in range(task.groups):
        context.progress(0.97, "uncertainty")
        mine = torch.nonzero(task.group == number)[:, 0]
        part = task.frames(mine)
        part = replace(part, group=torch.zeros(len(mine), dtype=torch.int64))
        groups[f"group_{number}"] = describe(
            part, values[number], search, number, observations, group == number, MEANING
        )
    if not out.any():
        context.say("too few frames to hold any out: the fit is judged on its own frames")
    drift = float(np.median(progress.drift))
    model = FittedModel(
        solver=settings.solver,
        loss=settings.loss,
        search=settings.how,
        control_node=node,
        fixed_nodes=list(rope.held_nodes),
        two_sided=settings.two_sided,
        groups=groups,
        heldout=out,
        x=state.x.numpy(),
        q=state.q.numpy(),
        x_initial=before.x.numpy(),
        residual=now.residual,
        rms=now.rms,
        rms_initial=then.rms,
        rms_px=now.rms_px,
        solver_converged=drift < DRIFT_ALLOWED,
        iterated=Iterated(
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
        trace=torch.stack(search.trace).sum(dim=1).numpy(),
        rms_fit=float(np.sqrt(np.mean(now.rms[train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(now.rms[out] ** 2))) if out.any() else None,
    )
    return {
        "recording": observations.recording,
        "length": observations.length,
        "frames": observations.frames,
        "models": {"nominal": model},
    }


def _check_names(settings: IdentifySettings, names: tuple[str, ...]) -> None:
    for name in [*(settings.free or []), *settings.start]:
        if name not in names:
            raise WrongUsage(f"unknown parameter {name}; one of {', '.join(names)}")
    for name, value in settings.start.items():
        low, high = bounds(name)
        if not low <= value <= high:
            raise WrongUsage(f"start {name} = {value:g} is outside its bounds {low:g}..{high:g}")


STAGE = Stage(name="identify", reads=(Observations,), writes=Model, compute=compute)
