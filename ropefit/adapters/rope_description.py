"""The identified rope, with what was found to be left out, as simulators need it described."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ropefit import attachments as records
from ropefit.adapters.causes import effect_of
from ropefit.adapters.frames import spread_evenly
from ropefit.adapters.motion_setup import span_of
from ropefit.adapters.rope_setup import base_setup
from ropefit.adapters.start_values import started_setup
from ropefit.artifacts import Diagnosis, FittedModel, Observations
from ropefit.artifacts.causes import Law
from ropefit.effects.place import nearest_node
from ropefit.errors import NotConverged
from ropefit.exporters import RopeDescription
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import AT_REST, PARAMETERS
from ropefit.rod.setup import Setup

POSES = 6
PER_WEIGHT = "m^2"  # unit of a moment over the rope's weight per length


@dataclass(frozen=True)
class Described:
    """The rope, the frames (P,) of its poses, and what could not be described."""

    rope: RopeDescription
    frames: np.ndarray
    notes: list[str]


def described(o: Observations, model: FittedModel, diagnosis: Diagnosis | None) -> Described:
    """Return the rope of a model in some poses, at rest with the causes of a diagnosis.

    Of a rope identified in motion the part between its grips is described, and its dampings are
    stated in the notes. The mass of `o` is known.
    Raises NotConverged.
    """
    solved = model.balance or model.stepped
    assert solved is not None
    known = solved.mass_known
    nodes = len(o.node_arc)
    index = np.arange(len(o.frames))
    used = spread_evenly(index, np.zeros(len(index), dtype=np.int64), POSES)
    first, notes = 0.0, []
    if model.stepped is None:
        setup = base_setup(o, nodes - 1)
    else:
        span = span_of(o, nodes - 1)
        setup, first = span.setup._replace(damping=None), span.first
        if first > 0 or span.last < o.length:
            notes.append(
                f"the rope between its grips, from {first:.4g} m to {span.last:.4g} m of its "
                f"{o.length:.4g} m"
            )
    setup = setup.frames(used)
    group = next(iter(model.groups.values()))
    density = float(setup.properties.density.mean())
    heavier = 1.0 if known else density  # without its mass a rope of 1 kg/m was fitted
    factor = 1.0 if known else density * float(np.linalg.norm(setup.gravity))
    fitted = {name: p.value for name, p in group.parameters.items()}
    if diagnosis and diagnosis.causes:  # the rope's own values, fitted along with the causes
        fitted |= {name: size.value for name, size in diagnosis.rope.items()}
    weighs = {name for name, p in PARAMETERS.items() if p.unit != p.unit_per_weight}
    values = {name: value * (factor if name in weighs else 1.0) for name, value in fitted.items()}
    setup = started_setup(setup, {n: v for n, v in values.items() if n in AT_REST}, o)
    notes += _dampings({n: v for n, v in values.items() if n not in AT_REST}, density)
    beside: tuple[Any, ...] = tuple(
        records.PointMass(nearest_node(setup, piece.arc_length - first, nodes), piece.mass)
        for piece in o.fittings.values()
        if piece.mass
    )
    whole = setup
    causes = (*diagnosis.known.values(), *diagnosis.causes.values()) if diagnosis else ()
    for cause in causes or model.laws.values():
        effect = effect_of(cause)
        given = effect.weighted(heavier) * cause.values
        named = dict(zip(cause.value_names, given.tolist(), strict=True))
        changed = effect.apply(whole, given)
        how = None
        if cause.law is not None and cause.law.form:
            how = effect.exported_form(cause.law.form, law_constants(cause.law, factor), beside)
        how = how or effect.exported(named, changed, nodes, beside)
        if how.settles and changed.remembers:
            notes.append(f"{cause.name}: export does not express path dependence")
            continue
        beside, whole = how.beside, changed if how.settles else whole
        if how.in_rope:
            setup = effect.apply(setup, given)
        if how.note:
            notes.append(how.note)
    point = Equilibrium(whole, []).at(np.empty(0))
    if not point.solution.converged.all():
        raise NotConverged("the rope reaches no equilibrium in some poses; export fewer frames")
    rope = _description(o, setup, whole, point.solution.x, beside)
    return Described(rope, o.frames[used], notes)


def law_constants(law: Law, factor: float) -> dict[str, float]:
    """Return a law's constants by name in SI; factor [N/m]: the weight per length over which
    moments are told where the mass is not known."""
    return {
        name: size.value * (factor if size.unit == PER_WEIGHT else 1.0)
        for name, size in law.parameters.items()
    }


def _dampings(values: dict[str, float], density: float) -> list[str]:
    """Return what to tell of the dampings of a rope identified in motion, density [kg/m]."""
    if not values:
        return []
    listed = ", ".join(f"{name} {v:.4g} {PARAMETERS[name].unit}" for name, v in values.items())
    rate = values.get("air_damping", 0.0) / density
    return [
        f"dampings of a rope in motion ({listed}) are not written: the text is of one that comes "
        f"to rest. The air takes {rate:.3g} 1/s of every velocity"
    ]


def _description(
    o: Observations, setup: Setup, whole: Setup, x: np.ndarray, extras: tuple[Any, ...]
) -> RopeDescription:
    p = setup.properties
    rest = p.length
    rod = setup.rod()
    at_nodes = 0.5 * (rest[1:] + rest[:-1])
    turn = 0.5 * (rest[1:, None] * p.curvature[1:] + rest[:-1, None] * p.curvature[:-1])
    curvature = (turn + setup.kinks[1:-1]) / at_nodes[:, None]
    half = 0.5 * p.density * rest
    with np.errstate(divide="ignore"):  # infinite where it does not stretch
        across, along = (1 / rod.flexibility[:, k] for k in (0, 2))
    return RopeDescription(
        length=float(rest.sum()),
        rest_lengths=rest.copy(),
        EA=along,
        GA=across,
        EI=rod.stiffness[1:-1, 0] * at_nodes / 4,
        GJ=rod.stiffness[1:-1, 2] * at_nodes / 4,
        rest_curvature=curvature[:, :2].copy(),
        rest_twist=curvature[:, 2].copy(),
        masses=np.pad(half, (0, 1)) + np.pad(half, (1, 0)),
        diameter=o.diameter,
        gravity=setup.gravity.copy(),
        end_kinds=tuple(  # type: ignore[arg-type]
            "free" if k == "free" else ("clamped" if c else "pinned")
            for k, c in zip(o.end_kind, whole.clamped, strict=True)
        ),
        end_positions=whole.ends.copy(),
        end_orientations=whole.clamp.copy(),
        x=x.copy(),
        effects=extras,
        name=o.recording,
    )
