"""A fitted rope, with its laws and causes, in poses of its ends that were not recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.causes import changed_by, effect_of
from ropefit.adapters.end_path import end_path
from ropefit.adapters.motion_of import SLOWEST
from ropefit.adapters.rope_setup import base_setup
from ropefit.adapters.start_values import started_setup
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.artifacts.causes import Cause
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.fitting.motion import identified_span, terms_of
from ropefit.models.dynamics import Dynamics
from ropefit.models.equilibrium import Equilibrium
from ropefit.rod.setup import Setup

LINES = 2  # frames in which a motion begins, at rest


def settled_rope(
    o: Observations, model: FittedModel, found: Diagnosis | None, ends: np.ndarray,
    clamp: np.ndarray,
) -> tuple[np.ndarray, Setup]:  # fmt: skip
    """Return the nodes (F, K, 3) [m] of a rope identified at rest, and its setup, in poses of its
    ends (F, 2, 3) [m] and clamps (F, 2, 4), one after the other: a rope that remembers goes through
    them. Raises WrongUsage, NotConverged."""
    assert model.balance is not None
    segments = (found.segments if found else 0) or model.balance.segments
    seen = base_setup(o, segments)
    still = seen._replace(motion=None)
    causes = [
        cause
        for cause in physical(model, found)
        # Poses are held still: what acts by how the rope moves is not there.
        if effect_of(cause).applies(still) or not effect_of(cause).applies(seen)
    ]
    setup = started_setup(_posed(still, ends, clamp), _values(model, found), o)
    setup = changed_by(setup, causes)
    point = Equilibrium(setup, []).at(np.empty(0))
    if not point.solution.converged.all():
        raise NotConverged("the rope reaches no equilibrium in some poses; bring the ends nearer")
    return point.solution.x[:, :: segments // (len(o.node_arc) - 1)], setup


def moving_rope(
    o: Observations, model: FittedModel, found: Diagnosis | None, ends: np.ndarray,
    clamp: np.ndarray, time: np.ndarray,
) -> tuple[np.ndarray, Setup]:  # fmt: skip
    """Return the same of a rope identified in motion, at times (F,) [s]: from rest at its first
    pose, which the ends must hold for LINES frames. Raises BadInput, WrongUsage, NotConverged."""
    span = identified_span(o, model)
    if span.first > 0 or span.last < o.length:
        raise WrongUsage("the run's rope begins at the second marker of a grip, not at its end")
    if np.diff(time).max() > SLOWEST:
        raise BadInput(f"a rope in motion needs frames at most {SLOWEST:g} s apart")
    setup = _posed(span.setup, ends, clamp)
    path = end_path(time, np.arange(len(time)), ends, clamp, o.length)
    setup = setup._replace(time=time, end_path=path)
    values, stated = _values(model, found), stated_units(o)
    free = next(iter(model.groups.values())).free_names
    for term in terms_of(o, replace(span, setup=setup), free):
        if not term.nuisance:
            value = np.array([values[term.name] / stated[term.name].factor])
            setup = term.apply(setup, value)
    setup = changed_by(setup, physical(model, found))
    still = setup.frames(np.zeros(1, dtype=int))
    still = still._replace(damping=None, drag=None, end_path=None, time=None, past=None)
    point = Equilibrium(still, []).at(np.empty(0))
    if not point.solution.converged.all():
        raise NotConverged("the rope does not come to rest in the first pose")
    lines = np.full((len(time), len(span.arc), 3), np.nan)
    lines[:LINES] = point.solution.x[:, :: span.every]
    moving = Dynamics(
        setup, [], time=time, clips=[np.arange(len(time))], observed=lines, every=span.every
    )
    x = moving.corrected(np.empty(0)).at(np.empty(0)).seen
    if not np.isfinite(x).all():
        raise NotConverged("the motion could not be simulated; move the ends more slowly")
    return x, setup


def physical(model: FittedModel, found: Diagnosis | None) -> list[Cause]:
    """Return what belongs to the rope and its surroundings: no error of how they were measured."""
    causes = (*found.known.values(), *found.causes.values()) if found else model.laws.values()
    return [cause for cause in causes if effect_of(cause).kind == "physics"]


def _values(model: FittedModel, found: Diagnosis | None) -> dict[str, float]:
    """Return the rope's own values as they are stated, those fitted along with causes if any."""
    if len(model.groups) > 1:
        raise WrongUsage("the run's rope has parameters by groups of frames; use --groups one")
    (group,) = model.groups.values()
    values = {name: p.value for name, p in group.parameters.items()}
    if found and found.causes:
        values |= {name: size.value for name, size in found.rope.items()}
    return values


def _posed(setup: Setup, ends: np.ndarray, clamp: np.ndarray) -> Setup:
    """Return the rope of a setup's first frame with ends (F, 2, 3) [m] and clamps (F, 2, 4), held
    as it is. Raises BadInput where they do not say how."""
    for end in range(2):
        held = bool(np.isfinite(setup.ends[:, end]).all())
        if held != bool(np.isfinite(ends[:, end]).all()):
            raise BadInput(f"motion.end{end}: the run's rope is {'held' if held else 'free'} there")
        if setup.clamped[end] and not np.isfinite(clamp[:, end]).all():
            raise BadInput(f"motion.end{end}: the run's rope is clamped there: give its tangents")
    setup = setup._replace(time=None, motion=None, end_path=None)
    setup = setup.frames(np.zeros(len(ends), dtype=int))
    orientation = np.where(np.array(setup.clamped)[:, None], clamp, np.nan)
    return setup._replace(ends=ends, clamp=orientation, past=None)
