"""The shape of every stage: declared inputs -> own settings -> a pure function -> an artifact.

`execute` does for all of them what must not be forgotten in any: refuse stale inputs, skip what is
up to date (and say why if it is not), stamp provenance, write atomically.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import BaseModel, ConfigDict

from ropefit import __version__
from ropefit.artifacts import Artifact, Provenance, read, write
from ropefit.artifacts.store import stored_hash
from ropefit.errors import BadInput, StageFailed
from ropefit.stages.checkpoint import checkpointed
from ropefit.stages.lock import tidy, working_on

# What shows or hands on results, and does not change them.
SHOWS = ("reporting/", "viewing/", "sample_data/", "cli", "console", "commands", "api", "__init__")
S = TypeVar("S", bound="StageSettings")
A = TypeVar("A", bound=Artifact)


class StageSettings(BaseModel):
    """Settings of one stage: only what it uses, so that nothing else makes it stale."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    def sha256(self) -> str:
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


Progress = Callable[[float, str], None]  # (share done in 0..1, what is going on)


@dataclass
class Context:
    """What a stage may use besides its inputs: where to tell progress, and things it was given."""

    progress: Progress = lambda share, text: None
    say: Callable[[str], None] = lambda text: None
    external: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Stage(Generic[S]):
    """A subcommand's work: compute(inputs by name, settings, context) -> the artifact's contents.

    `external` hashes inputs from outside the run directory (a recording, a target file).
    """

    name: str
    reads: tuple[type[Artifact], ...]
    writes: type[Artifact]
    compute: Callable[[dict[str, Any], S, Context], dict[str, Any]]


@dataclass(frozen=True)
class Outcome(Generic[A]):
    """The artifact, its path, and whether it was computed now or found up to date."""

    artifact: A
    path: Path
    computed: bool
    why: str


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
        tidy(directory)
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
    """The output if it is what would be computed, else None; why; inputs and their hashes."""
    inputs: dict[str, Any] = {}
    hashes = dict(external or {})
    for kind in stage.reads:
        inputs[kind.file_name], hashes[kind.file_name] = load(directory, kind)
    if force:
        return None, "asked to", inputs, hashes
    path = directory / stage.writes.file_name
    return *_up_to_date(path, stage, hashes, settings), inputs, hashes


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
    key = hashlib.sha256((code_sha256() + key_of(settings, hashes)).encode()).hexdigest()
    with checkpointed(directory, stage.name, key, context.say) as checkpoint:
        artifact = made(stage, inputs, hashes, settings, context)
    write(path, artifact)
    checkpoint.remove()
    return Outcome(artifact, path, computed=True, why=why)


def made(
    stage: Stage[S],
    inputs: dict[str, Any],
    hashes: Mapping[str, str],
    settings: S,
    context: Context,
) -> Any:
    """What a stage makes of its inputs, with its provenance; not written anywhere."""
    started = time.monotonic()
    content = stage.compute(inputs, settings, context)
    provenance = Provenance(
        stage=stage.name,
        package_version=__version__,
        code_sha256=code_sha256(),
        inputs=dict(hashes),
        settings=settings.model_dump(mode="json"),
        settings_sha256=settings.sha256(),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.monotonic() - started,
    )
    return stage.writes(provenance=provenance, **content)


def key_of(settings: StageSettings, hashes: Mapping[str, str]) -> str:
    """Identifies inputs and settings."""
    return settings.sha256() + "".join(f"{k}{v}" for k, v in sorted(hashes.items()))


def _up_to_date(
    path: Path, stage: Stage[Any], hashes: Mapping[str, str], settings: StageSettings
) -> tuple[Artifact | None, str]:
    """The output if it is what would be computed; else None and why it must be computed."""
    if not path.exists():
        return None, f"{path.name} does not exist yet"
    try:
        old, _ = read(path, stage.writes)
    except BadInput as error:
        return None, f"{path.name} is unreadable ({error})"
    was = old.provenance
    changed = [name for name in hashes if was.inputs.get(name) != hashes[name]]
    if changed:
        return None, f"{', '.join(changed)} changed"
    if was.package_version != __version__:
        return None, f"ropefit was {was.package_version}, is {__version__}"
    if was.code_sha256 != code_sha256():
        return None, "ropefit's code changed"
    if was.settings_sha256 != settings.sha256():
        new = settings.model_dump(mode="json")
        differ = [
            f"{key} {was.settings.get(key)} -> {value}"
            for key, value in new.items()
            if was.settings.get(key) != value
        ]
        return None, "settings changed: " + ", ".join(differ)
    return old, "up to date"


@cache
def code_sha256() -> str:
    """Hash of the source that results depend on: the whole package but what only shows them."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        name = path.relative_to(package).as_posix()
        if not name.startswith(SHOWS):
            digest.update(name.encode() + path.read_bytes())
    return digest.hexdigest()


def load(directory: Path, kind: type[A]) -> tuple[A, str]:
    """An artifact of a run and its hash, refused when what it was made from has changed since."""
    from ropefit.stages.run_directory import PRODUCERS

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
                f"{path}: made from {name}, gone; run `{PRODUCERS[name]} --run {directory}`"
            )
        if stored_hash(upstream) != recorded:
            raise StageFailed(
                f"{path}: stale, {name} has changed since; run `{command} --run {directory}`"
            )
    return artifact, digest


def load_if_there(directory: Path, kind: type[A]) -> A | None:
    """An artifact of a run; None where its stage has not run."""
    return load(directory, kind)[0] if (directory / kind.file_name).exists() else None
