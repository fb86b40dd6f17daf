"""The stages in a run directory: up to date or computed, their inputs refused where stale.

settings: of the stage, by name (`ropefit.adapters.settings`). context: where progress and sentences
go. Every function returns the artifact with its path, and whether it was computed now. All failures
are `ropefit.errors.RopefitError`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.settings import (
    NOMINAL_DIAGNOSIS,
    NOMINAL_OBSERVATIONS,
    DiagnoseSettings,
    PreprocessSettings,
)
from ropefit.api import pipeline
from ropefit.artifacts import Diagnosis, Model, Observations, read
from ropefit.artifacts.exports import Export
from ropefit.errors import BadInput, WrongUsage
from ropefit.fitting.settings import IdentifySettings
from ropefit.losses.names import IN_PICTURES
from ropefit.runs.execute import execute
from ropefit.runs.loading import load, load_if_there
from ropefit.runs.protocol import Context, Outcome
from ropefit.runs.run_directory import existing_run, new_run
from ropefit.solvers.compiling import telling

if TYPE_CHECKING:
    from ropefit.recordings import Recording

Given = Mapping[str, Any]


def preprocess(
    recording: Path,
    run: Path,
    settings: Given,
    context: Context,
    force: bool = False,
    debug_images: Path | None = None,
    replaces: bool = False,
) -> Outcome[Observations]:
    """Make observations.h5 of a recording.

    debug_images: a folder for pictures of every step, which are drawn only while it computes.
    Raises WrongUsage where the run holds another recording, unless `force` or `replaces`.
    """
    from ropefit.recordings import Masks, fingerprint, open_recording

    opened = open_recording(recording)
    chosen = PreprocessSettings(**settings)
    new_run(run)
    external = {"recording": fingerprint(opened)}
    if not (force or replaces):
        _refuse_another(run, opened, external["recording"])
    if chosen.mask:
        external["mask"] = Masks(Path(chosen.mask)).sha256()
    objects = {"recording": opened, "debug_images": debug_images}
    anew = force or debug_images is not None
    context = replace(context, external=objects)
    return execute(pipeline.PREPROCESS, run, chosen, context, external, anew)


def _refuse_another(run: Path, recording: Recording, fingerprint: str) -> None:
    """Refuse a recording that lies elsewhere and holds other data than the run's. The same folder
    with changed files, or the same files in another folder, are the same recording."""
    path = run / Observations.file_name
    try:
        held = read(path, Observations)[0] if path.exists() else None
    except BadInput:  # damaged: it cannot be said whose it is, and is made anew
        return
    if held is None or held.provenance.inputs.get("recording") == fingerprint:
        return
    if Path(held.recording_path) != Path(recording.path).resolve():
        raise WrongUsage(
            f"{run}: holds the recording {held.recording} ({held.recording_path}), not "
            f"{recording.name} ({recording.path}); give another --run, or --force to replace it"
        )


def identify(
    run: Path, settings: Given, context: Context, from_run: Path | None = None, force: bool = False
) -> Outcome[Model]:
    """Make model.h5 of observations.h5, and of another run's model.h5 if `from_run` is given."""
    chosen = IdentifySettings(**settings, from_run=from_run is not None)
    existing_run(run)
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if from_run is not None:
        objects["from"], external["--from"] = load(existing_run(from_run), Model)
        objects["from_path"] = str(from_run)
    context = replace(context, external=objects)
    return execute(pipeline.IDENTIFY, run, chosen, context, external, force)


def diagnosable(model: Model) -> bool:
    """Return whether a model is diagnosed unasked: one with a rope's properties, not the paper's
    weights, nor a fit by its losses."""
    return model.nominal.search == "least-squares"


def controllable(model: Model) -> bool:
    """Return whether a model tells where a control point was: not one of a rope in motion."""
    return model.nominal.stepped is None


def diagnose(
    run: Path,
    settings: Given,
    context: Context,
    nominal: Path | None = None,
    calibration: Path | None = None,
    force: bool = False,
    simulation: Path | None = None,
) -> Outcome[Diagnosis]:
    """Make diagnosis.h5 of observations.h5 and model.h5.

    nominal, calibration: other runs whose rope, or whose camera and gravity, are taken as known: a
    run that has only observations.h5 is identified first, by the nominal rope's solver. simulation:
    a run of a simulator's recording of the same motion.
    """
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    for name, other in (("nominal", nominal), ("calibration", calibration)):
        if other is not None:
            objects[name], external[name] = load(existing_run(other), Model)
    given = dict.fromkeys(objects, True)
    for name, kind in ((NOMINAL_DIAGNOSIS, Diagnosis), (NOMINAL_OBSERVATIONS, Observations)):
        if nominal is not None and (nominal / kind.file_name).exists():
            objects[name], external[name] = load(nominal, kind)
    if simulation is not None:
        objects["simulation"], external["--simulation"] = load(
            existing_run(simulation), Observations
        )
        given["simulation"] = True
    chosen = DiagnoseSettings(**settings, **given)
    existing_run(run)
    if objects and not (run / Model.file_name).exists() and (run / Observations.file_name).exists():
        if simulation is not None:  # before anything is fitted
            from ropefit.fitting.simulation import check_same_motion

            check_same_motion(load(run, Observations)[0], objects["simulation"])
        moving = nominal is not None and objects["nominal"].nominal.stepped is not None
        solver = "dynamics" if moving else "equilibrium"
        context.say(f"no {Model.file_name} yet: ropefit identify --solver {solver}")
        identify(run, {"solver": solver}, context)
    context = replace(context, external=objects)
    return execute(pipeline.DIAGNOSE, run, chosen, context, external, force)


def control(
    run: Path, settings: Given, context: Context, target: Path | None = None, force: bool = False
) -> Outcome[Any]:
    """Make control.h5 of observations.h5, model.h5, and diagnosis.h5 if there is one.

    target: a table of points that the rope is to pass.
    """
    chosen = ControlSettings(**settings, target=target is not None)
    existing_run(run)
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if target is not None:
        from ropefit.adapters.targets import read_targets

        objects["targets"] = read_targets(target, load(run, Observations)[0].length)
        external["target"] = objects["targets"].sha256
    if (run / Diagnosis.file_name).exists():  # the rope with what was found to be left out
        objects["diagnosis"], external[Diagnosis.file_name] = load(run, Diagnosis)
    context = replace(context, external=objects)
    return execute(pipeline.CONTROL, run, chosen, context, external, force)


def check_targets(run: Path, target: Path) -> None:
    """Raise BadInput where a table of target points is not one for the rope of observations.h5."""
    from ropefit.adapters.targets import read_targets

    read_targets(target, load(run, Observations)[0].length)


def control_by(
    run: Path, loss: str, context: Context, force: bool = False, target: Path | None = None
) -> Outcome[Any]:
    """Make control.h5 as a part of all stages: where there is no depth, by the loss in pictures.

    target: a csv of points that the rope is to pass.
    """
    other = IN_PICTURES.get(loss)
    in_space = target is not None or load(run, Observations)[0].depth_measured
    if other is not None and not in_space:
        context.say(f"control: the recording has no depth: by {other}, as {loss} compares in space")
        loss = other
    return control(run, {"loss": loss}, context, target, force)


@dataclass(frozen=True)
class Exported:
    """What was recorded of an export in exports.h5, and the files that were written.

    length: of the exported rope as observed [m].
    """

    record: Export
    files: list[str]
    length: float


def export(
    run: Path,
    target: str,
    out: Path,
    context: Context,
    mass: float | None = None,
    checks: bool = False,
    python: Path | None = None,
) -> Exported:
    """Write the rope of observations.h5, model.h5 and diagnosis.h5 (if there is one) for a
    simulator, and record it in exports.h5.

    mass: of the whole rope [kg], if the recording does not say it. checks: let the rope come to
    rest in the simulator that `python` has.
    """
    from ropefit.exporters.resimulate import version

    python = python or Path(sys.executable)
    if checks:  # before anything is written
        version(target, python)
    existing_run(run)
    from ropefit.stages.export import check, export_run, record, write_export

    started = time.monotonic()
    o, model = load(run, Observations)[0], load(run, Model)[0]
    diagnosis = load_if_there(run, Diagnosis)
    with telling(context.say):
        made = export_run(o, model, diagnosis, target, mass)
    files = write_export(made.result, out)
    context.say(f"export: {', '.join(files)} written for {target}")
    for note in made.notes:
        context.say(f"note: {note}")
    checked = check(made, target, out, python, context.progress) if checks else None
    seconds = time.monotonic() - started
    kept = record(run, target, out, made, diagnosis, model, checked, seconds)
    return Exported(kept, files, o.length)
