"""What each command does: call stages, say what came out. Stages are imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ropefit.artifacts import Control, Diagnosis, FittedModel, Model, Observations
from ropefit.console import Session
from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.stages.run_directory import existing_run, new_run
from ropefit.stages.stage import Context, Outcome, Stage, StageSettings, execute, load


def _stage(
    session: Session,
    stage: Stage[Any],
    run: Path,
    settings: StageSettings,
    force: bool,
    objects: dict[str, Any] | None = None,
    external: dict[str, str] | None = None,
) -> Outcome[Any]:
    context = Context(run, session.progress(stage.name), session.say, external=objects or {})
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


def identify(session: Session, run: Path, settings: dict[str, Any], force: bool) -> dict[str, Any]:
    """observations.h5 -> model.h5."""
    from ropefit.stages import identify as stage

    chosen = stage.IdentifySettings(**settings)
    outcome = _stage(session, stage.STAGE, existing_run(run), chosen, force)
    model: Model = outcome.artifact
    m = model.nominal
    rows = []
    for name, group in m.groups.items():
        for key, p in group.parameters.items():
            interval = f"{p.ci95[0]:.4g} .. {p.ci95[1]:.4g}" if p.ci95 else "-"
            if p.below is not None:
                interval = f"below {p.below:.4g}"
            partners = f" with {', '.join(p.trades_with)}" if p.trades_with else ""
            label = f"{name} {key}" if len(m.groups) > 1 else key
            label += "" if p.unit == "1" else f" [{p.unit}]"
            rows.append(
                [label, f"{p.initial:.4g}", f"{p.value:.4g}", interval, p.verdict + partners]
            )
    session.table(
        f"{model.recording}: {m.solver}, {m.loss}, {m.search}",
        ["parameter", "before", "after", "95 % interval", "verdict"],
        rows,
    )
    heldout = "none held out" if m.rms_heldout is None else f"held out {m.rms_heldout * 1e3:.3g} mm"
    session.say(
        f"point-to-line rms: fitted frames {m.rms_fit * 1e3:.3g} mm, {heldout}, "
        f"before {np.sqrt(np.mean(m.rms_initial**2)) * 1e3:.3g} mm"
    )
    _say_how_it_settled(session, m)
    for group in m.groups.values():
        if not group.converged:
            session.say(f"warning: the search did not converge ({group.stop_reason})")
    return {
        "stage": "identify",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "solver": m.solver,
        "loss": m.loss,
        "search": m.search,
        "groups": {
            name: {
                "frames": group.frames,
                "parameters": {key: p.model_dump() for key, p in group.parameters.items()},
                "loss_before": group.loss_before,
                "loss_after": group.loss_after,
                "converged": group.converged,
                "stop_reason": group.stop_reason,
            }
            for name, group in m.groups.items()
        },
        "rms_fit_m": m.rms_fit,
        "rms_heldout_m": m.rms_heldout,
        "solver_converged": m.solver_converged,
        **_settled(m),
    }


def _say_how_it_settled(session: Session, m: FittedModel) -> None:
    if m.iterated and not m.solver_converged:
        session.say(
            f"the solver has not converged: iterated twice as long, particles move by "
            f"{np.median(m.iterated.drift):.2%} of the length; the weights belong to "
            f"{m.iterated.steps} x {m.iterated.iterations} iterations and are not properties of "
            "the rope"
        )
    if m.balance is None:
        return
    b = m.balance
    if not b.mass_known:
        session.say(
            "the mass is not known: shapes fix rigidities over the weight per length only; bending "
            f"length (EI/w)^(1/3) = {b.bending_length:.4g} m"
        )
    lost = int((~b.converged).sum())
    if lost:
        session.say(f"warning: {lost} of {len(b.converged)} frames reach no equilibrium (marked)")
    twice = int(np.isfinite(b.other).sum())
    if twice:
        session.say(f"{twice} of {len(b.other)} frames have a second stable equilibrium")


def _settled(m: FittedModel) -> dict[str, Any]:
    """How the states were found, for --json."""
    if m.iterated:
        return {
            "drift": float(np.median(m.iterated.drift)),
            "length_error": float(np.mean(np.abs(m.iterated.length_error[:, -1]))),
        }
    assert m.balance is not None
    b = m.balance
    return {
        "frames_converged": int(b.converged.sum()),
        "smallest_eigenvalue_N": b.stability,
        "other_equilibrium_m": b.other,
        "mass_known": b.mass_known,
        "bending_length_m": b.bending_length,
        "calibration": {name: item.model_dump() for name, item in b.calibration.items()},
        "noise_correlated_m": b.correlated_noise,
        "noise_correlation_length_m": b.correlation_length,
    }


def diagnose(
    session: Session,
    run: Path,
    settings: dict[str, Any],
    nominal: Path | None,
    force: bool,
) -> dict[str, Any]:
    """observations.h5, model.h5 -> diagnosis.h5."""
    from ropefit.stages import diagnose as stage

    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if nominal is not None:
        objects["nominal"], external["nominal"] = load(existing_run(nominal), Model)
    chosen = stage.DiagnoseSettings(**settings, nominal=nominal is not None)
    outcome = _stage(session, stage.STAGE, existing_run(run), chosen, force, objects, external)
    d: Diagnosis = outcome.artifact
    _tell_diagnosis(session, d)
    return {
        "stage": "diagnose",
        "artifact": str(outcome.path),
        "computed": outcome.computed,
        "verdict": d.verdict,
        "effects": [
            {
                "name": c.name,
                "kind": c.kind,
                "arc_length_m": c.arc_length,
                "frames": c.frames,
                "parameters": {key: size.model_dump() for key, size in c.parameters.items()},
                "equivalent_to": c.equivalent_to,
                "evidence": {
                    "heldout_log_likelihood_gain": float(c.heldout_gain.sum()),
                    "log_bayes_factor": c.log_evidence,
                    "p_value": c.p_value,
                },
                "description": c.sentence,
            }
            for c in d.causes.values()
        ],
        "mismatch": [
            {
                "arc_length_m": r.arc_length,
                "frames": r.frames,
                "rms_m": r.rms,
                "direction": r.direction,
            }
            for r in d.mismatch
        ],
        "heldout": {
            "rms_before_m": d.rms_before,
            "rms_after_m": d.rms_after,
            "noise_m": d.noise_white,
        },
        "detectable": {key: item.model_dump() for key, item in d.detectable.items()},
        "next_motion": {"separates": d.separates, "description": d.motion},
        "refused": d.refused,
        "latent_force": {"log_evidence": d.force_evidence, "threshold": d.force_threshold},
    }


def _tell_diagnosis(session: Session, d: Diagnosis) -> None:
    if d.verdict == "none":
        session.say("nothing was left out: what the nominal model does not explain is noise")
    elif d.verdict == "unknown":
        session.say(
            "something was left out that no effect of the catalogue explains; see the latent force "
            "in the report"
        )
    rows = []
    for c in d.causes.values():
        where = "-" if c.arc_length is None else f"{c.arc_length[0]:.3f} .. {c.arc_length[1]:.3f}"
        key, size = next(iter(c.parameters.items()))
        rows.append(
            [
                c.name,
                where,
                f"{key} {size.value:.3g} ({size.ci95[0]:.3g} .. {size.ci95[1]:.3g}) {size.unit}",
                ", ".join(c.equivalent_to) or "-",
                f"{c.log_evidence:.1f}",
            ]
        )
    if rows:
        session.table(
            f"{d.recording}: left out",
            ["what", "where [m]", "size (95 %)", "or as well", "nats"],
            rows,
        )
        for c in d.causes.values():
            session.say(c.sentence)
    session.say(
        f"held-out frames: rms {d.rms_before * 1e3:.3g} mm before, {d.rms_after * 1e3:.3g} mm "
        f"after; noise of a point {d.noise_white * 1e3:.3g} mm"
    )
    for reason in d.refused:
        session.say(f"not believed: {reason}")
    if d.motion:
        session.say(f"to tell {' from '.join(d.separates)}: {d.motion}")


def control(
    session: Session, run: Path, settings: dict[str, Any], target: Path | None, force: bool
) -> dict[str, Any]:
    """observations.h5, model.h5 -> control.h5."""
    from ropefit.stages import control as stage
    from ropefit.stages.targets import read_targets

    chosen = stage.ControlSettings(**settings)
    existing_run(run)
    objects: dict[str, Any] = {}
    external: dict[str, str] = {}
    if target is not None:
        length = load(run, Observations)[0].length
        objects["targets"] = read_targets(target, length)
        external["target"] = objects["targets"].sha256
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


def export(
    session: Session, run: Path, target: str, out: Path, mass: float | None
) -> dict[str, Any]:
    """observations.h5, model.h5, diagnosis.h5 if there -> text for a simulator."""
    from ropefit.stages.export import export_run, write_export

    existing_run(run)
    o, model = load(run, Observations)[0], load(run, Model)[0]
    there = (run / Diagnosis.file_name).exists()
    diagnosis = load(run, Diagnosis)[0] if there else None
    result, notes = export_run(o, model, diagnosis, target, mass)
    files = write_export(result, out)
    session.say(f"export: {', '.join(files)} written for {target}")
    for note in notes:
        session.say(f"note: {note}")
    effects = [c.name for c in diagnosis.causes.values()] if diagnosis else []
    return {"stage": "export", "files": files, "effects": effects, "notes": notes}


def report(session: Session, run: Path) -> dict[str, Any]:
    """Everything in the run -> report.html."""
    from ropefit.stages.report import write_report

    path = write_report(existing_run(run), session.say)
    session.say(f"report: {path}")
    return {"stage": "report", "report": str(path)}


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
    """preprocess, identify, diagnose, control, report."""
    data = {
        "preprocess": preprocess(session, recording, run, of_preprocess, force, debug_images),
        "identify": identify(session, run, of_identify, force),
    }
    if data["identify"]["search"] == "least-squares":  # the paper's weights say nothing of a rope
        data["diagnose"] = diagnose(session, run, {}, None, force)
    return data | {
        "control": control(session, run, of_control, None, force),
        "report": report(session, run),
    }


def inspect(session: Session, path: Path) -> dict[str, Any]:
    """What an artifact or a run holds."""
    from ropefit.stages.inspect import inspect_path

    data = inspect_path(path)
    for item in data["artifacts"]:
        title = f"{item['file']}: {item['schema']} version {item['version']}"
        session.table(
            f"{title}, {'valid' if item['valid'] else 'NOT VALID: ' + item['problem']}",
            ["entry", "shape", "unit", "what"],
            [[e["name"], e["shape"], e["unit"], e["value"]] for e in item["entries"]],
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
