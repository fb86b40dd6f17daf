"""identify: the weights of the paper's model that make simulation and observations agree."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import Field, field_validator, model_validator

from ropefit import __version__
from ropefit.artifacts import (
    Checkpoint,
    FittedModel,
    Iterated,
    Model,
    Observations,
    Parameter,
    ParameterGroup,
    Provenance,
    read,
    write,
)
from ropefit.errors import BadInput, NotConverged, RopefitError, WrongUsage
from ropefit.inference import minimise
from ropefit.inference.evaluate import agreement, convergence, settle_frames
from ropefit.inference.identify import Task, gradient_search, grid_search, uncertainty
from ropefit.inference.minimise import Search
from ropefit.inference.parameters import Space
from ropefit.inference.rope import MEANING, bounds, eta_names
from ropefit.inference.uncertainty import verdicts
from ropefit.losses.objectives import OBJECTIVES, LossName
from ropefit.solvers.xpbd import Settings
from ropefit.stages import identify_equilibrium
from ropefit.stages.frames import group_frames, held_out, spread_evenly
from ropefit.stages.scene import build_scene, check_loss, control_positions, node_at, rope_of
from ropefit.stages.stage import Context, Stage, StageSettings

CHECKPOINT_EVERY = 15.0  # s
DRIFT_ALLOWED = 1e-3  # of the length: a solver that still moves more than this has not converged
FLAT = np.log(3.0)  # an interval beyond a factor of three up and down determines nothing


class IdentifySettings(StageSettings):
    """What is fitted, how, to which frames. Distances in m, dt in s."""

    solver: Literal["jacobi", "thomas", "equilibrium"] = "equilibrium"
    loss: LossName = "OBJ1"
    search: Literal["gradient", "grid", "least-squares"] | None = None
    free: list[str] | None = None
    start: dict[str, float] = Field(default_factory=dict)
    groups: str = "one"
    two_sided: bool = False
    control_at: float | None = None
    steps: int = Field(default=50, ge=1, le=1000)
    iterations: int = Field(default=20, ge=1, le=100_000)
    dt: float = Field(default=0.1, gt=0, le=100)
    compliance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    evaluations: int = Field(default=60, ge=1)
    levels: int = Field(default=3, ge=2, le=9)
    rounds: int = Field(default=3, ge=1, le=20)
    holdout: float = Field(default=0.2, ge=0, lt=1)
    most_frames: int = Field(default=60, ge=1)

    @model_validator(mode="after")
    def _search_fits(self) -> IdentifySettings:
        if self.search == "least-squares" and self.solver != "equilibrium":
            raise WrongUsage("--search least-squares needs --solver equilibrium")
        return self

    @property
    def how(self) -> str:
        """The search, chosen by the solver if not given."""
        return self.search or ("least-squares" if self.solver == "equilibrium" else "gradient")

    @field_validator("compliance")
    @classmethod
    def _positive(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if not all(0 <= alpha < 1e12 for alpha in value):
            raise ValueError("expected three numbers >= 0: shear, bend, distance")
        return value


def compute(inputs: dict[str, Any], settings: IdentifySettings, context: Context) -> dict[str, Any]:
    """The contents of model.h5. Raises BadInput, NotConverged."""
    observations: Observations = inputs[Observations.file_name]
    check_loss(observations, settings.loss)
    if settings.how == "least-squares":
        return identify_equilibrium.compute(observations, settings, context)
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

    search = _search(task, settings, context)
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
        groups[f"group_{number}"] = _describe(
            part, values[number], search, number, observations, group == number
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
    Path(context.directory / Checkpoint.file_name).unlink(missing_ok=True)
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


def _search(task: Task, settings: IdentifySettings, context: Context) -> Search:
    """Run or resume the search, saving it every few seconds."""
    path = context.directory / Checkpoint.file_name
    resume = _restore(path, context.key)
    if resume:
        context.say(f"resumed after {resume.evaluations} evaluations")
    goal = settings.evaluations if settings.how == "gradient" else settings.rounds
    saved = time.monotonic()

    def report(search: Search) -> None:
        nonlocal saved
        done = search.evaluations if settings.how == "gradient" else int(search.calm[0])
        context.progress(0.9 * done / goal, f"{settings.loss} {float(search.loss.min()):.4g} m")
        if time.monotonic() - saved > CHECKPOINT_EVERY:
            _save(path, context.key, search)
            saved = time.monotonic()

    if settings.how == "gradient":
        return gradient_search(task, settings.evaluations, resume, report)
    return grid_search(task, settings.levels, settings.rounds, resume, report)


def _save(path: Path, key: str, search: Search) -> None:
    provenance = Provenance(stage="identify", package_version=__version__)
    arrays = {
        name: getattr(search, name).detach().numpy()
        for name in ("u", "loss", "gradient", "inverse", "status", "calm")
    }
    write(
        path,
        Checkpoint(
            provenance=provenance,
            key=key,
            evaluations=search.evaluations,
            trace=torch.stack(search.trace).numpy(),
            **arrays,
        ),
    )


def _restore(path: Path, key: str) -> Search | None:
    """The saved search, or None if there is none of these inputs and settings."""
    if not path.exists():
        return None
    try:
        saved, _ = read(path, Checkpoint)
    except RopefitError:
        return None
    if saved.key != key:
        return None
    tensors = [
        torch.tensor(getattr(saved, name))
        for name in ("u", "loss", "gradient", "inverse", "status", "calm")
    ]
    u, loss, gradient, inverse, status, calm = tensors
    evaluations, trace = saved.evaluations, list(torch.tensor(saved.trace))
    return Search(u, loss, gradient, inverse, status, calm, evaluations, trace)


def _describe(
    task: Task,
    values: np.ndarray,
    search: Search,
    number: int,
    observations: Observations,
    member: np.ndarray,
) -> ParameterGroup:
    """Intervals and verdicts of one group's parameters."""
    space = task.space
    floor = float(np.median(observations.noise))
    found = uncertainty(task, values, floor, observations.length)
    judged = verdicts(found, space.at_bound(values), FLAT)
    with torch.no_grad():
        start = task.loss(space.to_search(space.start[None]), torch.zeros(1, dtype=torch.int64))
    parameters = {}
    for i, name in enumerate(space.names):
        place = space.free.index(i) if i in space.free else None
        interval, verdict, partners = None, "fixed", []
        if place is not None and not search.converged[number]:
            verdict = "not converged"
        elif place is not None:
            verdict, partners = judged[place]
            width = found.half_width[place]
            if np.isfinite(width) and width < 50:
                interval = (values[i] * np.exp(-width), values[i] * np.exp(width))
        parameters[name] = Parameter(
            meaning=MEANING[name],
            initial=space.start[i],
            value=values[i],
            lower=space.lower[i],
            upper=space.upper[i],
            free=place is not None,
            verdict=verdict,
            ci95=interval,
            trades_with=[space.free_names[j] for j in partners],
        )
    return ParameterGroup(
        frames=observations.frames[member],
        parameters=parameters,
        free_names=space.free_names,
        correlation=found.correlation,
        condition=found.condition if np.isfinite(found.condition) else None,
        loss_before=float(start[0]),
        loss_after=float(search.loss[number]),
        evaluations=search.evaluations,
        converged=bool(search.converged[number]),
        stop_reason=minimise.REASONS[int(search.status[number])],
    )


STAGE = Stage(name="identify", reads=(Observations,), writes=Model, compute=compute)
