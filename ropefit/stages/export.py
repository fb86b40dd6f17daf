"""export: the identified rope, with what was found to be left out, as text for a simulator."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.diagnosis import Cause
from ropefit.effects.place import horizontal, middle_of
from ropefit.errors import NotConverged, StageFailed, WrongUsage
from ropefit.exporters import ExportResult, RopeDescription, export
from ropefit.exporters import effects as records
from ropefit.inference.forward import Forward
from ropefit.rod.setup import Setup
from ropefit.stages.frames import spread_evenly
from ropefit.stages.identify_equilibrium import started_setup, unit_scale
from ropefit.stages.restore import effect_of
from ropefit.stages.rope_setup import base_setup
from ropefit.stages.shapes_only import shapes_only

POSES = 6
BAR = 2.0  # m: length of a bar that the model takes as endless


@dataclass(frozen=True)
class Exported:
    """The text, the rope it was made from, the frames (P,) of its poses, and what to say of it."""

    result: ExportResult
    rope: RopeDescription
    frames: np.ndarray
    notes: list[str]


def export_run(
    o: Observations, model: Model, diagnosis: Diagnosis | None, target: str, mass: float | None
) -> Exported:
    """The rope as text for `target`. Raises WrongUsage, NotConverged."""
    shapes_only(model.nominal, "export")
    if model.nominal.balance is None:
        raise WrongUsage(
            f"the model was fitted by {model.nominal.solver}, whose weights no simulator knows; "
            "run ropefit identify --solver equilibrium first"
        )
    if o.mass is None and mass is None:
        raise WrongUsage(
            "the rope's mass is not known, and shapes fix only ratios to it; weigh it: --mass KG"
        )
    o = o.model_copy(update={"mass": mass or o.mass})
    known = model.nominal.balance.mass_known
    nodes = len(o.node_arc)
    index = np.arange(len(o.frames))
    used = spread_evenly(index, np.zeros(len(index), dtype=np.int64), POSES)
    setup = base_setup(o, nodes - 1).frames(torch.from_numpy(used))
    group = next(iter(model.nominal.groups.values()))
    density = float(setup.properties.density.mean())
    factor = 1.0 if known else density * float(setup.gravity.norm())
    fitted = {name: p.value for name, p in group.parameters.items()}
    if diagnosis and diagnosis.causes:  # the rope's own values, fitted along with the causes
        fitted |= {name: size.value for name, size in diagnosis.rope.items()}
    values = {name: value * (factor if name != "length" else 1.0) for name, value in fitted.items()}
    scale = unit_scale(o)
    setup = started_setup(setup, values, scale)
    notes = []
    extras: list[Any] = []
    whole = setup
    for cause in diagnosis.causes.values() if diagnosis else []:
        effect = effect_of(cause)
        if cause.name == "contact_friction":  # of what the rope touches, which goes along already
            extras = [_rough(extra, float(cause.values[0])) for extra in extras]
            continue
        changed = effect.apply(whole, torch.tensor(cause.values))
        if changed.remembers:
            notes.append(f"{cause.name}: no target's rope remembers how it was bent; left out")
            continue
        whole = changed
        record = _record(cause, whole, nodes)
        if record is not None:
            extras.append(record)
        elif cause.name in ("point_mass", "tether", "support_plane", "obstacle"):
            notes.append(f"{cause.name} could not be turned into the simulator's terms")
        elif cause.name == "distributed_load":
            notes.append("distributed_load: no target takes it; add it as a force on every node")
        else:
            setup = effect.apply(setup, torch.tensor(cause.values))
    point = Forward(whole, []).at(np.empty(0))
    if not point.solution.converged.all():
        raise NotConverged("the rope reaches no equilibrium in some poses; export fewer frames")
    rope = _description(o, setup, whole, point.solution.x, tuple(extras))
    result = export(rope, target)
    return Exported(result, rope, o.frames[used], [*notes, *result.not_expressed])


def write_export(result: ExportResult, out: Path) -> list[str]:
    """Write the text and what goes beside it. Raises StageFailed."""
    written = []
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        beside = [(out.parent / name, text) for name, text in result.files.items()]
        for path, text in [(out, result.text), *beside]:
            path.write_text(text, encoding="utf-8")
            written.append(str(path))
    except OSError as error:
        raise StageFailed(f"cannot write {out}: {error.strerror}; give another --out")
    return written


def _record(cause: Cause, setup: Setup, nodes: int) -> Any:
    """What goes along as a thing of its own; None for what changes the rope itself."""
    v = dict(zip(cause.value_names, cause.values.tolist(), strict=True))
    length = float(setup.properties.length.sum())
    origin = middle_of(setup).numpy()
    up = -(setup.gravity / setup.gravity.norm()).detach().numpy()
    if cause.name in ("point_mass", "tether"):
        node = round(v["arc_length"] / length * (nodes - 1))
    if cause.name == "point_mass":
        return records.PointMass(node, v["mass"])
    if cause.name == "tether" and v["stiffness"] > 0:
        pull = np.array([v["pull_x"], v["pull_y"], v["pull_z"]])
        anchor = origin + pull / v["stiffness"]
        return records.Tether(node, _three(anchor), v["stiffness"], 0.0)
    if cause.name == "support_plane":
        first, second = _horizontal(setup)
        normal = up - v["slope_1"] * first - v["slope_2"] * second
        return records.Plane(_three(origin + v["height"] * up), _three(normal))
    if cause.name == "obstacle":
        first, second = _horizontal(setup)
        axis = np.cos(v["heading"]) * first + np.sin(v["heading"]) * second
        middle = origin + np.array([v["x"], v["y"], v["z"]])
        start, stop = _three(middle - BAR / 2 * axis), _three(middle + BAR / 2 * axis)
        return records.Cylinder(start, stop, v["radius"])
    return None


def _rough(extra: Any, coefficient: float) -> Any:
    if isinstance(extra, records.Plane | records.Cylinder):
        return replace(extra, friction=coefficient)
    return extra


def _horizontal(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    first, second = horizontal(setup.gravity)
    return first.numpy(), second.numpy()


def _three(v: np.ndarray) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _description(
    o: Observations, setup: Setup, whole: Setup, x: np.ndarray, extras: tuple[Any, ...]
) -> RopeDescription:
    p = setup.properties
    rest = p.length.numpy()
    rod = setup.rod()
    at_nodes = 0.5 * (rest[1:] + rest[:-1])
    turn = 0.5 * (
        rest[1:, None] * p.curvature[1:].numpy() + rest[:-1, None] * p.curvature[:-1].numpy()
    )
    curvature = (turn + setup.kinks[1:-1].numpy()) / at_nodes[:, None]
    half = 0.5 * (p.density * p.length).numpy()
    return RopeDescription(
        length=float(rest.sum()),
        rest_lengths=rest.copy(),
        EA=(1 / rod.flexibility[:, 2]).numpy(),  # infinite where it does not stretch
        GA=(1 / rod.flexibility[:, 0]).numpy(),
        EI=rod.stiffness[1:-1, 0].numpy() * at_nodes / 4,
        GJ=rod.stiffness[1:-1, 2].numpy() * at_nodes / 4,
        rest_curvature=curvature[:, :2].copy(),
        rest_twist=curvature[:, 2].copy(),
        masses=np.pad(half, (0, 1)) + np.pad(half, (1, 0)),
        diameter=o.diameter,
        gravity=setup.gravity.detach().numpy().copy(),
        end_kinds=tuple(  # type: ignore[arg-type]
            "free" if k == "free" else ("clamped" if c else "pinned")
            for k, c in zip(o.end_kind, whole.clamped, strict=True)
        ),
        end_positions=whole.ends.numpy().copy(),
        end_orientations=whole.clamp.numpy().copy(),
        x=x.copy(),
        effects=extras,
        name=o.recording,
    )
