"""Whether a stage's output is what it would compute now; if not, what changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ropefit import __version__
from ropefit.artifacts import Artifact, read
from ropefit.errors import BadInput
from ropefit.runs.code import code_sha256
from ropefit.runs.protocol import Stage, StageSettings


def key_of(settings: StageSettings, hashes: Mapping[str, str]) -> str:
    """Identify inputs and settings."""
    return settings.sha256() + "".join(f"{k}{v}" for k, v in sorted(hashes.items()))


def up_to_date(
    path: Path, stage: Stage[Any], hashes: Mapping[str, str], settings: StageSettings
) -> tuple[Artifact | None, str]:
    """Return the output if it is what would be computed; else None and why it must be computed.

    hashes: of the inputs, by name.
    """
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
    if was.code_sha256 != code_sha256(stage.module):
        return None, "ropefit's code changed"
    if was.settings_sha256 != settings.sha256():
        differ = [
            f"{key} {was.settings.get(key)} -> {value}"
            for key, value in settings.used().items()
            if was.settings.get(key) != value
        ]
        return None, "settings changed: " + ", ".join(differ)
    return old, "up to date"
