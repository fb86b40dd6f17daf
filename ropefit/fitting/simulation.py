"""Diagnoses of a simulation that is not the rod of this package: the paper's, or another one's.

The simulation is diagnosed like a recording without noise: which rope it is, and what it does that
no such rope does (stretch, few nodes, iterations that stop early), and what of the recording's
effects it has as well. The recording is diagnosed as usual: what it has beyond that is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ropefit.adapters.motion_of import centrelines, times_of
from ropefit.adapters.rope_setup import STATIONS, data_in_space
from ropefit.adapters.settings import DiagnoseSettings
from ropefit.artifacts import FittedModel, Model, Observations
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Simulation
from ropefit.diagnosis.held_out import points_rms
from ropefit.diagnosis.rules import Rules
from ropefit.effects import CATALOGUE
from ropefit.errors import BadInput, NotConverged
from ropefit.fitting import equilibrium, motion
from ropefit.fitting.diagnosed import at_rest, in_motion
from ropefit.fitting.settings import IdentifySettings
from ropefit.inference.bins import match
from ropefit.runs.protocol import Context, Progress

NOISE = 1e-4  # of the length: what shapes of another discretisation differ by
SAME_END, SAME_LENGTH = 0.01, 0.02  # of the length: ends and lengths of one motion
SAME_PLACE = 0.05  # of the length: an effect's place in recording and simulation
SAME_STEP = 0.01  # of the time between two frames of a motion


def of_weights(
    o: Observations, model: Model, settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Diagnose the paper's simulation, as fitted by its weights. Raises like `at_rest`.

    Its model predicts the shapes. What they lack is looked for beside a rod fitted to them: the
    iterations are no balance of forces, so no rigidity, weight or force has a derivative there.
    """
    from ropefit.adapters.xpbd_model import restored_xpbd

    point = restored_xpbd(o, model.nominal).at(np.empty(0))
    if not point.converged.all():
        frame = o.frames[np.argmin(point.converged)]
        raise NotConverged(
            f"frame {frame}: the {model.nominal.solver} solver diverges; use more --steps"
        )
    shapes = as_markers(o, point.seen)
    name = f"the fitted {model.nominal.solver} simulation"
    return _both(o, None, shapes, name, settings, context, rules)


def of_simulation(
    o: Observations, model: Model, settings: DiagnoseSettings, context: Context, rules: Rules
) -> dict[str, Any]:
    """Diagnose another simulator's recording of the same motion (`context.external`), at rest or,
    where the model is of a motion, in motion. Raises BadInput, NotConverged, WrongUsage."""
    shapes: Observations = context.external["simulation"]
    check_same_motion(o, shapes)
    steps, own = model.nominal.stepped is not None, model.nominal.search == "least-squares"
    if steps:
        check_same_times(o, shapes)
    fitted = model if steps or (model.nominal.balance and own) else None
    return _both(o, fitted, shapes, shapes.recording, settings, context, rules)


def _both(
    o: Observations, fitted: Model | None, shapes: Observations, name: str,
    settings: DiagnoseSettings, context: Context, rules: Rules,
) -> dict[str, Any]:  # fmt: skip
    """Diagnose the simulated shapes, and the recording."""
    part = replace(context, progress=_share(context.progress, 0.0, "recording"))
    steps = fitted is not None and fitted.nominal.stepped is not None
    diagnose = in_motion if steps else at_rest
    real = diagnose(o, fitted or _at_rest(o), settings, part, rules)
    own = DiagnoseSettings(seed=settings.seed, most_frames=settings.most_frames)
    part = replace(context, progress=_share(context.progress, 0.5, "simulation"))
    found = {name for c in real["causes"].values() for name in (c.name, *c.equivalent_to)}
    names = tuple(sorted(found | {kind.name for kind in CATALOGUE if kind.of_simulators}))
    many = rules.most_effects + len(real["causes"])
    own_rules = replace(rules, effects=names, most_effects=many)
    model = _stepped(shapes, fitted, part) if fitted and steps else _at_rest(shapes)
    simulated = diagnose(shapes, model, own, part, own_rules)
    missing, differences = beside(real["causes"], simulated["causes"], o.length)
    differences = [*_apart(real["rope"], simulated["rope"]), *differences]
    rows = np.searchsorted(o.frames, real["frames"])
    now, seen = _nodes(shapes)[rows], data_in_space(o).frames(rows)
    rms = points_rms(stations := match(seen, now, STATIONS), stations.residual)
    return real | {
        "rms_before": rms,  # of the simulation: what the user has before
        "simulation": Simulation(
            name=name, verdict=simulated["verdict"], effects=simulated["causes"],
            rope=simulated["rope"], refused=simulated["refused"], x=now, rms=rms,
            missing=missing, differences=differences,
            rms_converged=real["rms_before"], rms_of_rope=simulated["rms_before"],
            rms_explained=simulated["rms_after"],
        )
    }  # fmt: skip


def _nodes(shapes: Observations) -> np.ndarray:
    """Return (F, K, 3) [m] the simulated nodes; of few markers, on a spline through these."""
    told = shapes.centreline
    return told if np.isfinite(told).all() else centrelines(shapes, shapes.node_arc)


def beside(
    real: dict[str, Cause], simulated: dict[str, Cause], length: float
) -> tuple[list[str], list[str]]:
    """Return the names of a recording's effects that a simulation lacks, and a sentence on each
    size of an effect that both have, outside the two 95 % intervals together. length [m]."""
    missing, differences = [], []
    for cause in real.values():
        same = next((c for c in simulated.values() if _alike(cause, c, length)), None)
        if same is None:
            missing.append(cause.name)
            continue
        if same.name == cause.name:
            told = _apart(cause.parameters, same.parameters)
            differences += [f"{cause.name}: {sentence}" for sentence in told]
    return missing, differences


def _apart(real: dict[str, Size], simulated: dict[str, Size]) -> Iterator[str]:
    """Yield a sentence on each size that recording and simulation have, in one unit, farther apart
    than their 95 % intervals together."""
    for key in (key for key in real if key in simulated):
        a, b = real[key], simulated[key]
        both = float(np.hypot(np.ptp(a.ci95), np.ptp(b.ci95))) / 2
        if a.unit == b.unit and abs(a.value - b.value) > both:
            unit = "" if a.unit == "1" else f" {a.unit}"
            yield (
                f"{key} is {a.value:.3g}{unit} in the recording and {b.value:.3g}{unit} in the "
                "simulation"
            )


def _alike(a: Cause, b: Cause, length: float) -> bool:
    """Return whether two effects are the same or indistinguishable, at the same place."""
    if a.end != b.end or not {a.name, *a.equivalent_to} & {b.name, *b.equivalent_to}:
        return False
    if a.arc_length is None or b.arc_length is None:
        return True
    near = SAME_PLACE * length
    return a.arc_length[0] - near < b.arc_length[1] and b.arc_length[0] - near < a.arc_length[1]


def _at_rest(o: Observations) -> Model:
    """Return the rope in equilibrium that fits best."""
    return _model(o, equilibrium.compute(o, IdentifySettings(), Context()))


def _stepped(o: Observations, like: Model, context: Context) -> Model:
    """Return the rope in motion that fits best, with the free parameters of another model."""
    (group,) = like.nominal.groups.values()
    settings = IdentifySettings(solver="dynamics", free=list(group.free_names), holdout=0.0)
    told = _share(context.progress, 0.0, "identify")
    quiet = replace(context, progress=lambda _, text: told(0.0, text))
    return _model(o, motion.compute(o, settings, quiet))


def _model(o: Observations, nominal: FittedModel) -> Model:
    return Model.model_construct(
        recording=o.recording, length=o.length, frames=o.frames, models={"nominal": nominal}
    )


def _share(progress: Progress, begin: float, what: str) -> Callable[[float, str], None]:
    """Return the progress of one half as that of the whole."""
    return lambda share, text: progress(begin + 0.5 * share, f"{what}: {text}")


def as_markers(o: Observations, x: np.ndarray) -> Observations:
    """Return a recording's frames as a simulation x (F, K, 3) [m] shows them: markers at its nodes,
    without those at the ends."""
    frames, nodes = x.shape[:2]
    inner = x[:, 1:-1]
    start = np.arange(frames + 1) * (nodes - 2)
    return o.model_copy(
        update={
            "source": "markers", "points": inner.reshape(-1, 3), "point_start": start,
            "point_arc": np.tile(o.node_arc[1:-1], frames), "point_before": None,
            "point_offset": np.zeros(inner.shape[0] * inner.shape[1]), "projected": False,
            "centreline": x, "noise": np.full(frames, NOISE * o.length),
            "end_position": _ends_of(o, x), "ends_assumed": False,
        }
    )  # fmt: skip


def _ends_of(o: Observations, x: np.ndarray) -> np.ndarray:
    """Return (F, 2, 3) [m] the ends of a simulation where the recording holds them."""
    held = np.isfinite(o.end_position)
    return np.where(held, x[:, [0, -1]], np.nan)


def check_same_motion(o: Observations, shapes: Observations) -> None:
    """Raise BadInput where a simulation is not of the recording's motion."""
    if len(shapes.frames) != len(o.frames):
        raise BadInput(
            f"the simulation has {len(shapes.frames)} frames and the recording {len(o.frames)}; "
            "simulate every frame of the recording, and no others"
        )
    if abs(shapes.length - o.length) > SAME_LENGTH * o.length:
        raise BadInput(
            f"the simulated rope is {shapes.length:.3g} m long and the recorded one "
            f"{o.length:.3g} m; give both the same length"
        )
    if shapes.end_kind != o.end_kind:
        raise BadInput(
            f"the simulated ends are {', '.join(shapes.end_kind)} and the recorded ones "
            f"{', '.join(o.end_kind)}; hold both alike"
        )
    if len(shapes.node_arc) != len(o.node_arc):
        raise BadInput("preprocess both with the same --nodes")
    apart = np.nanmax(np.linalg.norm(shapes.end_position - o.end_position, axis=-1), initial=0.0)
    if apart > SAME_END * o.length:
        raise BadInput(
            f"the ends of simulation and recording lie up to {1e3 * apart:.3g} mm apart; give the "
            "simulation the recorded motion of the ends"
        )


def check_same_times(o: Observations, shapes: Observations) -> None:
    """Raise BadInput where a simulation has other times between its frames than the recording."""
    own, simulated = np.diff(times_of(o)), shapes.time
    if simulated is None:
        raise BadInput("the simulation has no times; write those of the recording into it")
    apart = np.abs(np.diff(simulated) - own)
    if (apart > SAME_STEP * own).any():
        k = int(np.argmax(apart / own))
        raise BadInput(
            f"from frame {o.frames[k]} to the next pass {own[k]:.4g} s in the recording and "
            f"{np.diff(simulated)[k]:.4g} s in the simulation; give both the same times"
        )
