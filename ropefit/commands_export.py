"""What `export` does and says: the text, and where the simulator lets it come to rest."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.exports import Export, deviation
from ropefit.console import Session
from ropefit.exporters import exporter
from ropefit.exporters.resimulate import version
from ropefit.reporting.sections.exports import settled, told
from ropefit.runs.loading import load, load_if_there
from ropefit.runs.run_directory import existing_run
from ropefit.solvers.compiling import telling


def export(
    session: Session,
    run: Path,
    target: str,
    out: Path,
    mass: float | None,
    checks: bool,
    python: Path | None,
) -> dict[str, Any]:
    """observations.h5, model.h5, diagnosis.h5 if there -> text for a simulator, exports.h5."""
    from ropefit.stages.export import check, export_run, record, write_export

    python = python or Path(sys.executable)
    if checks:  # before anything is written
        version(target, python)
    existing_run(run)
    started = time.monotonic()
    o, model = load(run, Observations)[0], load(run, Model)[0]
    diagnosis = load_if_there(run, Diagnosis)
    with telling(session.say):
        exported = export_run(o, model, diagnosis, target, mass)
    files = write_export(exported.result, out)
    session.say(f"export: {', '.join(files)} written for {target}")
    for note in exported.notes:
        session.say(f"note: {note}")
    checked = None
    if checks:
        checked = check(exported, target, out, python, session.progress("check"))
        session.finish()
    seconds = time.monotonic() - started
    made = record(run, target, out, exported, diagnosis, model, checked, seconds)
    data = {"stage": "export", "files": files, "effects": made.effects, "notes": made.notes}
    return data | {"check": _tell_check(session, target, made, o.length)}


def _tell_check(
    session: Session, target: str, made: Export, length: float
) -> dict[str, Any] | None:
    check = made.check
    if check is None:
        if exporter(target).simulator is not None:
            session.say(f"not tried in {target}: --check lets it come to rest there and measures")
        return None
    off = deviation(made, length)
    rows = [
        [str(frame), failure or f"{share:.3%}", "-" if failure else f"{1e3 * share * length:.3g}"]
        for frame, failure, share in zip(made.frames, check.failures, off, strict=True)
    ]
    session.table(
        f"at rest in {check.simulator}: largest deviation from this simulation",
        ["frame", "of the rope's length", "[mm]"],
        rows,
    )
    session.say(told(target, made, length))
    session.say("ropefit report puts this into the report")
    return {
        "simulator": check.simulator,
        "frames": made.frames,
        "settled": settled(check),
        "deviation": off,
        "largest_deviation": float(np.nanmax(off)) if np.isfinite(off).any() else None,
    }
