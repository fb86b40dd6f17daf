"""What each command does: call stages, say what came out. Stages are imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ropefit.artifacts import Control, Diagnosis, Model, Observations
from ropefit.commands_diagnose import tell_diagnosed
from ropefit.commands_identify import tell_identified
from ropefit.commands_show import report, tell_answer
from ropefit.console import Session
from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.reporting.words import unit_text
from ropefit.runs.execute import execute
from ropefit.runs.loading import load
from ropefit.runs.protocol import Context, Outcome, Stage, StageSettings
from ropefit.runs.run_directory import existing_run, new_run
from ropefit.solvers.compiling import telling


def _stage(
    session: Session,
    stage: Stage[Any],
    run: Path,
    settings: StageSettings,
    force: bool,
    objects: dict[str, Any] | None = None,
    external: dict[str, str] | None = None,
) -> Outcome[Any]:
    context = Context(session.progress(stage.name), session.say, external=objects or {})
    with telling(session.say):
        outcome = execute(stage, run, settings, context, external, force)
    session.finish()
    if outcome.computed:
        seconds = outcome.artifact.provenance.seconds
        session.say(f"{stage.name}: {outcome.path} written in {seconds:.1f} s ({outcome.why})")
    else:
        session.say(f"{stage.name}: {outcome.path} is up to date (--force computes it again)")
    return outcome


def preprocess(
    session: Session,
    recording: Path | None,
    run: Path,
    settings: dict[str, Any],
    force: bool,
    debug_images: Path | None = None,
) -> dict[str, Any]:
    """Recording -> observations.h5."""
    from ropefit.recordings import Masks, fingerprint, open_recording, sample_path
    from ropefit.stages import preprocess as stage

    if recording is None:
        recording = sample_path()
        session.say(f"no RECORDING given: using the packaged sample {recording}")
    opened = open_recording(recording)
    chosen = stage.PreprocessSettings(**settings)
    new_run(run)
    external = {"recording": fingerprint(opened)}
    if chosen.mask:
        external["mask"] = Masks(Path(chosen.mask)).sha256()
    outcome = _stage(
        session,
        stage.STAGE,
        run,
        chosen,
        force or debug_images is not None,  # pictures are drawn only while it computes
        {"recording": opened, "debug_images": debug_images},
        external,
    )
    o: Observations = outcome.artifact
    data = {
        "stage": "preprocess",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "recording": o.recording,
        "frames": len(o.frames),
        "dropped": [item.model_dump() for item in o.dropped],
        "length_m": o.length,
        "length_source": o.length_source,
        "ends": list(o.end_kind),
        "ends_assumed": o.ends_assumed,
        "noise_m": float(np.median(o.noise)),
        "visibility": float(o.visibility.mean()),
        "projected": o.projected,
        "projection": o.projection_reason,
        "depth_measured": o.depth_measured,
        "noise_correlated_m": o.noise_correlated,
        "noise_length_m": o.noise_length,
        "length_sd_m": o.length_sd,
        "quality": float(np.median(o.quality)) if o.quality is not None else None,
    }
    session.table(
        f"{o.recording}: observations",
        ["", ""],
        [
            ["frames", f"{len(o.frames)} used, {len(o.dropped)} dropped"],
            [
                "rope",
                f"{o.length:.4g} m ({o.length_source}); ends {o.end_kind[0]}, {o.end_kind[1]}",
            ],
            ["noise", f"{np.median(o.noise) * 1e3:.2g} mm ({o.noise_source})"],
            ["seen", f"{o.visibility.mean():.0%} of the rope"],
            ["plane", o.projection_reason],
        ],
    )
    if o.ends_assumed:
        session.say("no [ends] in the recording: the ends seen in the data are taken as pinned")
    if not o.depth_measured:
        session.say(
            "no depth in the recording: points lie on an assumed plane; only OBJ2, OBJ5 and OBJ8, "
            "which compare pictures, can be fitted"
        )
    return data


def identify(
    session: Session,
    run: Path,
    settings: dict[str, Any],
    from_run: Path | None,
    force: bool,
) -> dict[str, Any]:
    """observations.h5, and another run's model.h5 if it is given -> model.h5."""
    from ropefit.stages import identify as stage

    chosen = stage.IdentifySettings(**settings, from_run=from_run is not None)
    existing_run(run)
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if from_run is not None:
        other = load(existing_run(from_run), Model)
        objects = {"from": other[0], "from_path": str(from_run)}
        external = {"--from": other[1]}
    outcome = _stage(session, stage.STAGE, run, chosen, force, objects, external)
    return tell_identified(session, outcome)


def diagnose(
    session: Session,
    run: Path,
    settings: dict[str, Any],
    nominal: Path | None,
    calibration: Path | None,
    force: bool,
) -> dict[str, Any]:
    """observations.h5, model.h5 -> diagnosis.h5."""
    from ropefit.stages import diagnose as stage

    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    for name, other in (("nominal", nominal), ("calibration", calibration)):
        if other is not None:
            objects[name], external[name] = load(existing_run(other), Model)
    chosen = stage.DiagnoseSettings(
        **settings, nominal=nominal is not None, calibration=calibration is not None
    )
    outcome = _stage(session, stage.STAGE, existing_run(run), chosen, force, objects, external)
    return tell_diagnosed(session, outcome)


def control(
    session: Session, run: Path, settings: dict[str, Any], target: Path | None, force: bool
) -> dict[str, Any]:
    """observations.h5, model.h5, and diagnosis.h5 if there is one -> control.h5."""
    from ropefit.adapters.targets import read_targets
    from ropefit.stages import control as stage

    chosen = stage.ControlSettings(**settings)
    existing_run(run)
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if target is not None:
        length = load(run, Observations)[0].length
        objects["targets"] = read_targets(target, length)
        external["target"] = objects["targets"].sha256
    if (run / Diagnosis.file_name).exists():  # the rope with what was found to be left out
        objects["diagnosis"], external[Diagnosis.file_name] = load(run, Diagnosis)
    outcome = _stage(session, stage.STAGE, run, chosen, force, objects, external)
    c: Control = outcome.artifact
    rows = []
    if c.kind == "estimate":
        rows.append(["control point", *_spread(c.deviation, c.deviation_px)])
        for k in range(c.key_arc.shape[1]):
            label = f"key point at {c.key_arc[0, k]:.3g} m"
            rows.append([label, *_spread(c.key_deviation[:, k], c.key_deviation_px[:, k])])
    else:
        for case in range(len(c.cases)):
            at = ", ".join(f"{value:.4f}" for value in c.position[case])
            label = f"target {c.cases[case]}: gripper to ({at}) m"
            rows.append([label, *_spread(c.key_deviation[case], c.key_deviation_px[case])])
    session.table(
        f"{c.kind} by {c.loss_name}: deviation",
        ["", "median [mm]", "mean [mm]", "max [mm]", "mean [px]"],
        rows,
    )
    session.say(f"{int(c.converged.sum())} of {len(c.cases)} searches converged")
    for note in c.notes:
        session.say(f"note: {note}")
    return {
        "stage": "control",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "kind": c.kind,
        "loss": c.loss_name,
        "cases": c.cases,
        "position_m": c.position,
        "position_sd_m": c.position_sd,
        "orientation": c.orientation,
        "deviation_m": c.deviation,
        "deviation_px": c.deviation_px,
        "key_deviation_m": c.key_deviation,
        "key_deviation_px": c.key_deviation_px,
        "obj1_m": c.obj1,
        "length_error": c.length_error,
        "converged": c.converged,
        "notes": c.notes,
    }


def _spread(metres: np.ndarray, pixels: np.ndarray) -> list[str]:
    known = metres[np.isfinite(metres)] * 1e3
    if known.size == 0:
        return ["-", "-", "-", "-"]
    values = [np.median(known), known.mean(), known.max(), np.nanmean(pixels)]
    return [f"{value:.3g}" for value in values]


def run_all(
    session: Session,
    recording: Path | None,
    run: Path,
    of_preprocess: dict[str, Any],
    of_identify: dict[str, Any],
    of_control: dict[str, Any],
    force: bool,
    debug_images: Path | None = None,
) -> dict[str, Any]:
    """preprocess, identify, diagnose, control, report, and the answer in three sentences."""
    data = {
        "preprocess": preprocess(session, recording, run, of_preprocess, force, debug_images),
        "identify": identify(session, run, of_identify, None, force),
    }
    if data["identify"]["search"] == "least-squares":  # the paper's weights say nothing of a rope
        data["diagnose"] = diagnose(session, run, {}, None, None, force)
    data["control"] = control(session, run, of_control, None, force)
    data["report"] = report(session, [], run, [], None)
    return data | {"answer": tell_answer(session, run)}


def inspect(session: Session, path: Path) -> dict[str, Any]:
    """What an artifact or a run holds."""
    from ropefit.stages.inspect import inspect_path

    data = inspect_path(path)
    for item in data["artifacts"]:
        title = f"{item['file']}: {item['schema']} version {item['version']}"
        session.table(
            f"{title}, {'valid' if item['valid'] else 'NOT VALID: ' + item['problem']}",
            ["entry", "shape", "unit", "what"],
            [[e["name"], e["shape"], unit_text(e["unit"]), e["value"]] for e in item["entries"]],
        )
    if not all(item["valid"] for item in data["artifacts"]):
        session.result(data)
        bad = next(item for item in data["artifacts"] if not item["valid"])
        damaged = bad["exit_code"] == BadInput.exit_code
        raise (BadInput if damaged else StageFailed)(bad["problem"])
    return data


def simulate(session: Session, spec: Path, out: Path) -> dict[str, Any]:
    """SPEC.toml -> a recording."""
    from ropefit.stages.simulate import simulate_recording

    with telling(session.say):
        data = simulate_recording(spec, out, session.progress("simulate"), session.say)
    session.finish()
    session.say(f"simulate: {out} written, {data['frames']} frames")
    return data


def parse_numbers(option: str, text: str, count: int) -> list[float]:
    """`count` comma-separated numbers."""
    try:
        numbers = [float(item) for item in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise WrongUsage(f"{option} {text!r}: expected {count} numbers with commas between")
    return numbers


def parse_start(items: list[str]) -> dict[str, float]:
    """NAME=VALUE options."""
    out = {}
    for item in items:
        name, _, value = item.partition("=")
        try:
            out[name.strip()] = float(value)
        except ValueError:
            raise WrongUsage(f"--start {item!r}: expected NAME=VALUE with a number")
    return out
