"""Artifacts read from a run, refused where what they were made from has changed since."""

from __future__ import annotations

from pathlib import Path

from ropefit.artifacts import read
from ropefit.artifacts.store import stored_hash
from ropefit.errors import StageFailed
from ropefit.runs.protocol import A
from ropefit.runs.run_directory import PRODUCERS


def load(directory: Path, kind: type[A]) -> tuple[A, str]:
    """Return an artifact of a run and its hash.

    Raises StageFailed where it is missing or stale, BadInput where it is damaged.
    """
    path = directory / kind.file_name
    command = PRODUCERS[kind.file_name]
    if not path.exists():
        raise StageFailed(
            f"{directory}: has no {kind.file_name}; run `{command} --run {directory}` first"
        )
    artifact, digest = read(path, kind)
    for name, recorded in artifact.provenance.inputs.items():
        upstream = directory / name
        if name not in PRODUCERS:
            continue
        if not upstream.exists():
            raise StageFailed(
                f"{path}: was made from {name}, which is gone; run `{PRODUCERS[name]} --run "
                f"{directory}`"
            )
        if stored_hash(upstream) != recorded:
            raise StageFailed(
                f"{path}: stale, {name} has changed since; run `{command} --run {directory}`"
            )
    return artifact, digest


def load_if_there(directory: Path, kind: type[A]) -> A | None:
    """Return an artifact of a run; None where its stage has not run."""
    return load(directory, kind)[0] if (directory / kind.file_name).exists() else None
