"""export: the identified rope, with what was found to be left out, as text for a simulator.

What was exported goes into exports.h5, with where it comes to rest in the simulator itself.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ropefit import __version__
from ropefit.adapters.contents import current_exports
from ropefit.adapters.rope_description import described
from ropefit.artifacts import Diagnosis, Exports, Model, Observations, Provenance, write
from ropefit.artifacts.exports import Check, Export
from ropefit.errors import BadInput, StageFailed, WrongUsage
from ropefit.exporters import ExportResult, RopeDescription, export, resimulate
from ropefit.runs.code import code_sha256
from ropefit.runs.loading import load
from ropefit.runs.lock import working_on
from ropefit.runs.protocol import Progress


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
    """Return the rope as text for `target`. Raises WrongUsage, NotConverged."""
    if model.nominal.balance is None and model.nominal.stepped is None:
        raise WrongUsage(
            f"the model was fitted by {model.nominal.solver}, whose weights no simulator knows; "
            "run ropefit identify --solver equilibrium, or dynamics, first"
        )
    if o.mass is None and mass is None:
        raise WrongUsage(
            "the rope's mass is not known, and shapes fix only ratios to it; weigh it: --mass KG"
        )
    found = described(o.model_copy(update={"mass": mass or o.mass}), model.nominal, diagnosis)
    result = export(found.rope, target)
    return Exported(result, found.rope, found.frames, [*found.notes, *result.not_expressed])


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


def check(exported: Exported, target: str, text: Path, python: Path, progress: Progress) -> Check:
    """Return every pose at rest in the simulator that `python` has. A pose that does not come to
    rest is marked. Raises StageFailed where the simulator is missing."""
    rope, shapes, failures = exported.rope, [], []
    simulator = resimulate.version(target, python)
    for pose, frame in enumerate(exported.frames):
        progress(pose / rope.poses, f"{simulator}, frame {frame}")
        try:
            shapes.append(resimulate.settle(rope, target, text, pose, python))
            failures.append("")
        except resimulate.NotSettled as error:
            shapes.append(np.full(rope.x[pose].shape, np.nan))
            failures.append(str(error))
    return Check(simulator=simulator, x=np.array(shapes), failures=failures)


def record(
    run: Path,
    target: str,
    file: Path,
    exported: Exported,
    diagnosis: Diagnosis | None,
    model: Model,
    checked: Check | None,
    seconds: float,
) -> Export:
    """Put an export into exports.h5, beside those to other targets of the same rope."""
    frames = exported.frames
    balance = model.nominal.balance
    place = np.searchsorted(model.frames, frames)
    export = Export(
        file=file.name,
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        frames=frames,
        x=exported.rope.x,
        other=np.full(len(frames), np.nan) if balance is None else balance.other[place],
        effects=[cause.name for cause in diagnosis.causes.values()] if diagnosis else [],
        notes=exported.notes,
        check=checked,
    )
    with working_on(run):
        inputs = {kind.file_name: load(run, kind)[1] for kind in (Observations, Model)}
        if diagnosis is not None:
            inputs[Diagnosis.file_name] = load(run, Diagnosis)[1]
        made = Exports(
            provenance=Provenance(
                stage="export",
                package_version=__version__,
                code_sha256=code_sha256(__name__),
                inputs=inputs,
                created=datetime.now(UTC).isoformat(timespec="seconds"),
                seconds=seconds,
            ),
            length=exported.rope.length,
            exports=_others(run, inputs) | {target: export},
        )
        write(run / Exports.file_name, made)
    return export


def _others(run: Path, inputs: dict[str, str]) -> dict[str, Export]:
    try:
        old = current_exports(run)
    except BadInput:  # damaged, and about to be replaced
        return {}
    return dict(old.exports) if old and old.provenance.inputs == inputs else {}
