"""What was exported goes into exports.h5, with where it comes to rest in the simulator itself."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ropefit import __version__
from ropefit.artifacts import Diagnosis, Exports, Model, Observations, Provenance, write
from ropefit.artifacts.exports import Check, Export
from ropefit.errors import BadInput, StageFailed
from ropefit.exporters import resimulate
from ropefit.runs.code import code_sha256
from ropefit.runs.loading import load
from ropefit.runs.lock import working_on
from ropefit.runs.protocol import Progress

if TYPE_CHECKING:
    from ropefit.stages.export import Exported


def check(exported: Exported, target: str, text: Path, python: Path, progress: Progress) -> Check:
    """Every pose at rest in the simulator that `python` has. A pose that does not come to rest is
    marked. Raises StageFailed where the simulator is missing."""
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
                code_sha256=code_sha256(),
                inputs=inputs,
                created=datetime.now(UTC).isoformat(timespec="seconds"),
                seconds=seconds,
            ),
            length=exported.rope.length,
            exports=_others(run, inputs) | {target: export},
        )
        write(run / Exports.file_name, made)
    return export


def current_exports(run: Path) -> Exports | None:
    """exports.h5 of the rope as it is now; None where there is none, or an earlier rope's."""
    path = run / Exports.file_name
    try:
        made = load(run, Exports)[0] if path.exists() else None
    except StageFailed:  # the rope was identified again since
        return None
    diagnosed = (run / Diagnosis.file_name).exists()
    return made if made and (Diagnosis.file_name in made.provenance.inputs) == diagnosed else None


def _others(run: Path, inputs: dict[str, str]) -> dict[str, Export]:
    try:
        old = current_exports(run)
    except BadInput:  # damaged, and about to be replaced
        return {}
    return dict(old.exports) if old and old.provenance.inputs == inputs else {}
