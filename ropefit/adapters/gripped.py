"""A rope identified in motion, at rest between its grips: what control moves."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ropefit.adapters.causes import with_causes
from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.motion_of import motion_of
from ropefit.adapters.motion_setup import PULLED, Span, span_of
from ropefit.adapters.priors import priors_of
from ropefit.adapters.restore import within_reach
from ropefit.adapters.rope_setup import CLAMPED, surface_sd
from ropefit.adapters.start_values import started_setup
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.models.equilibrium_rope import EquilibriumRope
from ropefit.models.gripped_rope import GrippedRope, gripped
from ropefit.models.grips import grips
from ropefit.models.parameters import AT_REST
from ropefit.models.priors import calibration
from ropefit.models.rope_values import NAMES, rope_values
from ropefit.rod.rod import at_nodes
from ropefit.rod.setup import Setup

SEGMENTS = CLAMPED // PULLED * PULLED
AIR = "air_damping"


def gripped_rope(
    o: Observations,
    model: FittedModel,
    position: np.ndarray,
    hold_frame: bool,
    found: Diagnosis | None,
    moving: bool,
) -> tuple[GrippedRope, Tensor]:
    """Return the rope of every frame with its control point at `position` (F, 3) [m], and its
    values (F, 4) in the order of NAMES: with what a diagnosis found, as fitted along with it.

    hold_frame: see `restored_rope`. moving: inertia and air act as the rope was observed to move,
    else it is at rest, wherever its ends are. Raises StageFailed for effects not installed.
    """
    span, end = span_of(o, SEGMENTS), 0 if model.control_node == 0 else 1
    ends = span.setup.ends
    outer = np.where([[[span.first > 0], [span.last < o.length]]], ends - o.end_position, 0.0)
    ends = ends.copy()
    ends[:, end] = position + outer[:, end]
    fitted = {name: p.value for name, p in next(iter(model.groups.values())).parameters.items()}
    if found and found.causes:
        fitted |= {name: size.value for name, size in found.rope.items()}
    start = {name: value for name, value in fitted.items() if name in AT_REST}
    setup = started_setup(span.setup._replace(damping=None), start, o)
    length = float(setup.properties.length.sum())
    ends = within_reach(ends, end, length)
    setup = setup._replace(ends=ends)
    values = torch.tensor([rope_values(setup)[name] for name in NAMES], dtype=torch.float64)
    plain = setup.properties
    setup = _calibrated(setup, span, o, model, found)
    if found and (found.causes or found.known):
        setup = with_causes(setup, found)
    if moving and (motion := motion_of(o, span.node_arc)) is not None:
        setup = _as_it_moves(setup._replace(motion=motion), o, fitted)
    rope = EquilibriumRope(setup, 1, 0 if end == 0 else setup.segments, recorded=ends, plain=plain)
    if hold_frame:
        rope = rope.holding_its_frame(values)
    middle = 0.5 * (o.node_arc[1:] + o.node_arc[:-1])
    share = (middle - span.first) / (span.last - span.first)
    segment = np.clip((share * SEGMENTS).astype(int), 0, SEGMENTS - 1)
    mixed = gripped(span.node_arc, o.node_arc)
    return GrippedRope(rope, outer, mixed, segment), values.expand(len(o.frames), len(NAMES))


def _as_it_moves(setup: Setup, o: Observations, fitted: dict[str, float]) -> Setup:
    """Return the setup with the loads of its inertia and of the air, by its motion as observed."""
    assert setup.motion is not None
    p, air = setup.properties, fitted.get(AIR, 0.0) / stated_units(o)[AIR].factor
    mass = at_nodes(0.5 * p.density * p.length) + setup.mass
    drag = at_nodes(0.5 * air * p.length)
    moved = mass[:, None] * setup.motion.acceleration + drag[:, None] * setup.motion.velocity
    return setup._replace(load=setup.load - moved)


def _calibrated(
    setup: Setup, span: Span, o: Observations, model: FittedModel, found: Diagnosis | None
) -> Setup:
    """Return the setup with the errors of the grips, and those of the set-up that were fitted."""
    assert model.stepped is not None
    diagnosed = found is not None and bool(found.causes)
    known = found.calibration if found and diagnosed else model.stepped.calibration
    priors = priors_of(o)
    errors = grips(setup, priors.end_orientation, span.twist)
    own = {term.name for term in errors}
    every = calibration(setup, priors, o.ends_assumed, surface_sd(o))
    errors += [term for term in every if term.name not in own]
    names = [
        [calibration_name(t, axis) if diagnosed else f"{t.name}_{axis}" for axis in t.names]
        for t in errors
    ]
    for term, mine in zip(errors, names, strict=True):
        if all(name in known for name in mine):
            setup = term.apply(setup, np.array([known[name].value for name in mine]))
    return setup
