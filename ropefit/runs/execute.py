"""Run a stage in a run directory.

`execute` does for every stage what must not be forgotten in any: refuse stale inputs, skip what is
up to date (and say why if it is not), stamp provenance, write atomically.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ropefit import __version__
from ropefit.artifacts import Artifact, Provenance, write
from ropefit.errors import StageFailed
from ropefit.runs.checkpoint import Saver, checkpoint_name, checkpointed
from ropefit.runs.code import code_sha256
from ropefit.runs.loading import load
from ropefit.runs.lock import LOCK, working_on
from ropefit.runs.protocol import Context, Outcome, S, Stage
from ropefit.runs.staleness import key_of, up_to_date


def execute(
    stage: Stage[S],
    directory: Path,
    settings: S,
    context: Context,
    external: Mapping[str, str] | None = None,
    force: bool = False,
) -> Outcome[Any]:
    """Run a stage in a run directory, unless its output is already what it would compute.

    Raises Busy when another process works on the run.
    """
    old, why, inputs, hashes = _look(stage, directory, settings, external, force)
    if old is not None:
        _tidy(directory, stage, settings, hashes)
        return Outcome(old, directory / stage.writes.file_name, computed=False, why=why)
    with working_on(directory):
        # Until the run was ours another process may have changed it, or done the work.
        old, why, inputs, hashes = _look(stage, directory, settings, external, force)
        if old is not None:
            return Outcome(old, directory / stage.writes.file_name, computed=False, why=why)
        return _compute(stage, directory, settings, context, inputs, hashes, why)


def _look(
    stage: Stage[S],
    directory: Path,
    settings: S,
    external: Mapping[str, str] | None,
    force: bool,
) -> tuple[Artifact | None, str, dict[str, Any], dict[str, str]]:
    """Return the output if it is what would be computed, else None; why; inputs and their
    hashes."""
    inputs: dict[str, Any] = {}
    hashes = dict(external or {})
    for kind in stage.reads:
        inputs[kind.file_name], hashes[kind.file_name] = load(directory, kind)
    if force:
        return None, "asked to", inputs, hashes
    path = directory / stage.writes.file_name
    return *up_to_date(path, stage, hashes, settings), inputs, hashes


def _compute(
    stage: Stage[S],
    directory: Path,
    settings: S,
    context: Context,
    inputs: dict[str, Any],
    hashes: dict[str, str],
    why: str,
) -> Outcome[Any]:
    path = directory / stage.writes.file_name
    key = _key(stage, settings, hashes)
    with checkpointed(directory, stage.name, key, context.say) as checkpoint:
        artifact = made(stage, inputs, hashes, settings, context)
    write(path, artifact)
    checkpoint.remove()
    return Outcome(artifact, path, computed=True, why=why)


def _key(stage: Stage[S], settings: S, hashes: Mapping[str, str]) -> str:
    """Identify code, inputs and settings of a checkpoint."""
    code = code_sha256(stage.module)
    return hashlib.sha256((code + key_of(settings, hashes)).encode()).hexdigest()


def _tidy(directory: Path, stage: Stage[S], settings: S, hashes: Mapping[str, str]) -> None:
    """Remove what a process left that was killed when all its work was done, if that may be."""
    left = directory / checkpoint_name(stage.name)
    if left.exists() or (directory / LOCK).exists():
        with suppress(StageFailed, OSError), working_on(directory):
            checkpoint = Saver(left, stage.name, _key(stage, settings, hashes), lambda _: None)
            if checkpoint.restored():  # of other settings it may still be resumed
                checkpoint.remove()


def made(
    stage: Stage[S],
    inputs: dict[str, Any],
    hashes: Mapping[str, str],
    settings: S,
    context: Context,
) -> Any:
    """Return what a stage makes of its inputs, with its provenance; not written anywhere."""
    started = time.monotonic()
    content = stage.compute(inputs, settings, context)
    provenance = Provenance(
        stage=stage.name,
        package_version=__version__,
        code_sha256=code_sha256(stage.module),
        inputs=dict(hashes),
        settings=settings.used(),
        settings_sha256=settings.sha256(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.monotonic() - started,
    )
    return stage.writes(provenance=provenance, **content)
