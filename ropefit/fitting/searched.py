"""identify by a loss of the paper, searched by gradient or grid, with the rope in equilibrium."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.adapters.equilibrium_model import model_of
from ropefit.adapters.frames import group_frames, held_out, spread_evenly
from ropefit.adapters.rope_setup import base_setup, data_in_space, segments_of
from ropefit.adapters.scene import build_scene
from ropefit.adapters.start_values import started_setup, with_values
from ropefit.adapters.units import stated_units
from ropefit.artifacts import FittedModel, Observations
from ropefit.errors import NotConverged, WrongUsage
from ropefit.fitting.choices import free_names, given_values, held_node
from ropefit.fitting.search import describe, run_search
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference import bfgs
from ropefit.inference.identify import Task
from ropefit.inference.search_space import Space
from ropefit.losses.objectives import objective
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.models.parameters import PARAMETERS
from ropefit.models.rope_values import NAMES, rope_values
from ropefit.runs.protocol import Context


def _accelerator(name: str) -> torch.device | None:
    """Return the device of that name; None for the CPU, which the compiled path serves better.

    Raises WrongUsage where it is not there.
    """
    if name == "cpu":
        return None
    if not torch.cuda.is_available():
        raise WrongUsage(
            f"--device {name}: PyTorch {torch.__version__} sees no such device; use --device cpu"
        )
    return torch.device(name)


def compute(o: Observations, settings: IdentifySettings, context: Context) -> FittedModel:
    """Return the nominal model. Raises BadInput, NotConverged, WrongUsage."""
    node = held_node(o, settings.control_at)
    given = given_values(o, settings, context)
    setup = started_setup(base_setup(o, segments_of(o)), given, o)
    free = free_names(settings, o)
    if not set(free) <= set(NAMES):
        raise WrongUsage(f"--search {settings.how} fits {', '.join(NAMES)}; leave out the rest")
    every = setup.segments // (len(o.node_arc) - 1)
    tied = "GJ" not in {*free, *given}
    rope = EquilibriumRope(setup, every, node, tied, device=_accelerator(settings.device))
    ranges = {name: PARAMETERS[name].range(setup) for name in NAMES}
    kept = {name: value for name, value in rope_values(setup).items() if name not in free}
    space = Space.of(NAMES, free, kept, ranges)
    group = group_frames(o, settings.groups)
    out = held_out(len(group), settings.holdout)
    train = spread_evenly(np.flatnonzero(~out), group, settings.most_frames)
    scene, loss = build_scene(o).tensors(), objective(settings.loss)
    full = Task(rope, scene, loss, space, torch.from_numpy(group))
    task = full.frames(torch.from_numpy(train))
    search = run_search(task, settings, context)
    if (search.status == bfgs.DIVERGED).any():
        raise NotConverged("no equilibrium at the start; look at the ends and the length")
    values = space.to_values(search.u).detach().numpy()
    if rope.tied:
        ratio = float(setup.properties.twist[0] / setup.properties.bend[0])
        values[:, NAMES.index("GJ")] = ratio * values[:, NAMES.index("EI")]
    context.progress(0.95, "uncertainty and stability")
    groups, points = describe(task, values, search, o, group, stated_units(o)), []
    for number in range(task.groups):
        index = np.flatnonzero(group == number)
        found = with_values(setup.frames(index), values[number])
        points.append((index, Equilibrium(found, []).at(np.empty(0))))
    return model_of(
        o, settings.loss, settings.how, node, setup, data_in_space(o), points, groups, out, train,
        torch.stack(search.trace).sum(dim=1).numpy(),
    )  # fmt: skip
