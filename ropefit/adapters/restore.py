"""The equilibrium model of a run, as its artifact has it: setup, values, calibration."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ropefit.adapters.causes import changed_by, with_causes
from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.priors import priors_of
from ropefit.adapters.rope_setup import base_setup
from ropefit.adapters.start_values import started_setup, with_values
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.errors import WrongUsage
from ropefit.models import rest_curve
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.priors import calibration
from ropefit.models.rope_values import NAMES, rope_values
from ropefit.solvers.equilibrium.branches import other_states

if TYPE_CHECKING:
    from torch import Tensor

    from ropefit.models.equilibrium_rope import EquilibriumRope

REACH = 0.995  # of the length: how far apart the ends of a rope that does not stretch may start


def restored_rope(
    o: Observations,
    model: FittedModel,
    ends: np.ndarray,
    hold_frame: bool,
    diagnosis: Diagnosis | None = None,
) -> tuple[EquilibriumRope, Tensor]:
    """Return the rope of every frame, in torch, with ends (F, 2, 3) [m] as a recording would tell
    them, and its values (F, 4) in the order of NAMES.

    Calibration errors are those of the fit, if it was one fit for all frames. With a diagnosis that
    found causes, the rope has them, and values and calibration are those fitted along with them.
    Of a model by the paper's solvers it is the rope that such a diagnosis has fitted. Raises
    WrongUsage where groups of frames have rest curves of their own.
    hold_frame: end 0 holds its frame although it is not clamped, to begin with the one that it has
    of itself.
    """
    import torch

    from ropefit.models.equilibrium_rope import EquilibriumRope

    found = diagnosis if diagnosis is not None and diagnosis.causes else None
    balance = model.balance
    fitted = found or balance
    assert fitted is not None
    segments = (found.segments if found else 0) or (balance.segments if balance else 0)
    setup = base_setup(o, segments)._replace(ends=ends)
    if balance is None and found:
        own = {name: size.value for name, size in found.rope.items() if name in NAMES}
        like = rope_values(started_setup(setup, own, o))
        values = np.tile([like[name] for name in NAMES], (len(o.frames), 1))
    else:
        values = restored_values(o, model)
    group = next(iter(model.groups.values())).parameters
    curve = {name: p.value for name, p in group.items() if name in rest_curve.NAMES}
    if found:
        curve |= {name: s.value for name, s in found.rope.items() if name in rest_curve.NAMES}
    if curve and len(model.groups) > 1:
        raise WrongUsage(
            "every group of frames has a rest curve of its own; identify with --groups one"
        )
    setup = started_setup(setup, curve, o)
    known = fitted.calibration
    if found or len(model.groups) == 1:
        for term in calibration(setup, priors_of(o), o.ends_assumed):
            value = [
                item.value if (item := known.get(calibration_name(term, axis))) else 0.0
                for axis in term.names
            ]
            setup = term.apply(setup, np.array(value))
    plain = None
    if found:
        for k, name in enumerate(NAMES):
            if name in found.rope:
                values[:, k] = found.rope[name].value / stated_units(o)[name].factor
        setup = with_values(setup, values[0])
        plain = setup.properties
        setup = with_causes(setup, found)
    elif model.laws:
        setup = with_values(setup, values[0])
        plain = setup.properties
        setup = changed_by(setup, model.laws.values())
    every = segments // (len(o.node_arc) - 1)
    near, past = None, None
    if setup.memory:
        # A rope that remembers comes into every frame as the recorded ends have brought it there.
        walked = Equilibrium(setup, []).at(np.empty(0))
        near, past = walked.solution, walked.solution.conditions.friction_elements
        setup = setup._replace(memory=(), bending=None)  # a law of bending is among them
    rope = EquilibriumRope(
        setup, every, model.control_node, recorded=ends, near=near, plain=plain,
        friction_elements=past,
    )  # fmt: skip
    if balance and not found and not model.laws and np.isfinite(balance.other).any():
        rope = _on_its_branch(rope, values, model)
    searched = torch.from_numpy(values)
    if hold_frame:
        rope = rope.holding_its_frame(searched)
    return rope, searched


def within_reach(ends: np.ndarray, end: int, length: float) -> np.ndarray:
    """Return ends (F, 2, 3) [m] of a rope of `length` [m], end `end` no farther off the other one
    than that."""
    arm = ends[:, end] - ends[:, 1 - end]
    far = np.linalg.norm(arm, axis=1, keepdims=True) / (REACH * length)
    shorter, out = ends[:, 1 - end] + arm / np.fmax(far, 1.0), ends.copy()
    out[:, end] = np.where(np.isfinite(arm), shorter, ends[:, end])
    return out


def _on_its_branch(
    rope: EquilibriumRope, values: np.ndarray, model: FittedModel
) -> EquilibriumRope:
    """Return the rope near those of its states that the model is in."""
    point = Equilibrium(with_values(rope.setup, values[0]), []).at(np.empty(0))
    found, apart = other_states(point.solution)
    near = point.solution.copy()
    for t in np.flatnonzero(np.isfinite(apart)):
        gap = [np.abs(s.x[t, :: rope.every] - model.x[t]).max() for s in (near, found)]
        if gap[1] < gap[0]:
            near.put(t, found, t)
    return replace(rope, near=near)


def restored_values(o: Observations, model: FittedModel) -> np.ndarray:
    """Return (F, 4) each frame's values in the order of NAMES, in the units of the setup."""
    scale = stated_units(o)
    out = np.full((len(o.frames), len(NAMES)), np.nan)
    for group in model.groups.values():
        out[np.isin(o.frames, group.frames)] = [
            p.value / scale[name][0] if (p := group.parameters.get(name)) else np.inf
            for name in NAMES
        ]
    return out
